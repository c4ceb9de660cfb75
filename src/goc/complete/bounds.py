"""Planes that an object ends at: kept from its evidence before it is filled in, and cut from its field after."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from goc.complete.compose import Composition, Measured, without_cavities
from goc.complete.hull import BAND
from goc.scene import Evidence, EvidenceGrid, HalfSpace, Mesh, SceneObject

_BEYOND = 1.0
"""Voxels behind a plane from which on space is empty: up to there the fill goes on, so that it can be cut exactly."""
_FOOT = 1.0
"""Voxels above its contact in which an object goes straight down: finer than what was measured or guessed there."""
_THIN = 0.25
"""The same for what is thinner than that."""
_LID = 1.5
"""Voxels below a contact in which the supporter is solid."""
_RIM = 1.5
"""Voxels round the outline of what stands there in which measured distances of both are blurred."""
_NOISE = 2.0
"""Voxels above a contact in which the supporter's measured surface is noise."""
_FOOT_SHARE, _LOWEST = 0.25, 0.02
"""An imprint is the outline of what was measured in the lowest share of the height, above the lowest points."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Imprint:
    """Where something stands on an object: within the outline the object is solid up to the plane, and ends there."""

    plane: HalfSpace
    """In front is what stands there."""
    axes: Float64[np.ndarray, "2 3"]
    """Unit, in the plane."""
    outline: Float64[np.ndarray, "e 3"]
    """Rows (a, b, c): inside, a·u + b·v + c ≤ 0 for the coordinates u, v along the axes."""

    def holds(self, points: Float64[np.ndarray, "p 3"], margin: float) -> Bool[np.ndarray, "p"]:
        """Which points are above or below the outline, or at most about `margin` beside it."""
        flat = points @ self.axes.T
        return (flat @ self.outline[:, :2].T + self.outline[:, 2] <= margin).all(axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds:
    """All planes that bound one object."""

    contact: HalfSpace | None = None
    """It stands on this one."""
    walls: tuple[HalfSpace, ...] = ()
    imprints: tuple[Imprint, ...] = ()
    """What stands on it."""


def bounds_of(objects: Sequence[SceneObject]) -> dict[int, Bounds]:
    """The planes that contacts and walls of objects set to each of them, by id."""
    imprints: dict[int, list[Imprint]] = {item.id: [] for item in objects}
    for item in objects:
        imprint = _imprint(item)
        if imprint is not None and item.contact is not None:
            for supporter in item.contact.on:
                imprints.setdefault(supporter, []).append(imprint)
    return {
        item.id: Bounds(
            contact=None if item.contact is None else item.contact.plane,
            walls=item.walls,
            imprints=tuple(imprints[item.id]),
        )
        for item in objects
    }


def without_strays(found: Measured, bounds: Bounds) -> Measured:
    """What was measured without what lies behind its planes, of which nothing is known then: what a model is told.

    Networks are not told that space behind the planes is empty: those of today then make undersides hollow
    (docs/decisions/0038).
    """
    state, mesh = found.evidence.state.copy(), found.mesh
    for plane in _planes(bounds):
        state[(state == Evidence.SURFACE) & (_heights(plane, found.evidence) < 0)] = Evidence.UNKNOWN
        mesh = _in_front(mesh, plane, -_BEYOND * found.evidence.voxel)
    return replace(found, evidence=replace(found.evidence, state=state), mesh=mesh)


def bounded(evidence: EvidenceGrid, bounds: Bounds) -> EvidenceGrid:
    """The evidence with what planes forbid: space behind them is empty, and that of things which stand on the object.

    Within a voxel behind a plane it stays as it is: see `cut`.
    """
    state = evidence.state.copy()
    for plane in _planes(bounds):
        state[_heights(plane, evidence) < -_BEYOND] = Evidence.EMPTY
    for imprint in bounds.imprints:
        at, height = _column(imprint, evidence, state == Evidence.UNKNOWN)
        state[tuple(at[height > _BEYOND].T)] = Evidence.EMPTY
    return replace(evidence, state=state)


def cut(composed: Composition, bounds: Bounds, solids: Sequence[Composition]) -> Composition:
    """A composed field that ends at its planes and at other solids, exactly: marching cubes put a flat face there.

    Above its contact an object goes straight down for the last voxel, except where rays passed. Within the outline of
    what stands on it, space that nobody saw is solid below the plane, and outside above it. Where `solids` are, which
    were there first, what was not measured gives way. A field of which nothing would be left is returned as it came.
    """
    grid = composed.evidence
    distance = composed.distance
    if bounds.contact is not None:
        distance = _standing(distance, bounds.contact, grid)
    for plane in bounds.walls:
        distance = np.maximum(distance, np.clip(-_heights(plane, grid), -BAND, BAND))
    for imprint in bounds.imprints:
        distance = _pressed(distance, imprint, grid)
    for solid in solids:
        distance = _giving_way(distance, grid, solid)
    if not (distance < 0).any():
        return composed
    distance = np.where(np.abs(distance) < 1e-3, np.copysign(np.float32(1e-3), distance), distance)
    planes = (*_planes(bounds), *(imprint.plane for imprint in bounds.imprints))
    return replace(composed, distance=without_cavities(distance.astype(np.float32)), planes=planes)


def _planes(bounds: Bounds) -> tuple[HalfSpace, ...]:
    return bounds.walls if bounds.contact is None else (bounds.contact, *bounds.walls)


def _standing(
    distance: Float32[np.ndarray, "x y z"], plane: HalfSpace, grid: EvidenceGrid
) -> Float32[np.ndarray, "x y z"]:
    """The field cut at a contact: what is a voxel above the plane goes on down to it."""
    height = _heights(plane, grid)
    result = np.maximum(distance, np.clip(-height, -BAND, BAND))
    free = (height > 0) & (height < _FOOT) & (grid.state == Evidence.UNKNOWN)
    near = np.argwhere(free | ((height <= 0) & (height > -2)))
    row = tuple(near.T)
    step = (_FOOT - height[row])[:, None] * plane.normal
    thin = np.maximum(_THIN - height[row], 0)[:, None] * plane.normal
    above = [ndimage.map_coordinates(distance, (near + by).T, order=1, mode="nearest") for by in (step, thin)]
    extruded = np.minimum(*above)
    here = np.where(height[row] > 0, np.minimum(distance[row], extruded), extruded)
    result[row] = np.maximum(here, -height[row])
    return result


def _pressed(
    distance: Float32[np.ndarray, "x y z"], imprint: Imprint, grid: EvidenceGrid
) -> Float32[np.ndarray, "x y z"]:
    """The field of a supporter with a flat face where something stands on it.

    Measured surface stays below the face, where it may be a hollow, and well above it, where it is something else.
    """
    at, height = _column(imprint, grid, distance < BAND)
    row = tuple(at.T)
    state, value = grid.state[row], distance[row]
    bound = (state != Evidence.SURFACE) | (height < _NOISE)
    lid = (height <= 0) & (state == Evidence.UNKNOWN)
    value = np.where(bound, np.maximum(value, np.minimum(height, BAND)), value)
    result = distance.copy()
    result[row] = np.where(lid, np.minimum(value, height), value)
    return result


def _giving_way(
    distance: Float32[np.ndarray, "x y z"], grid: EvidenceGrid, solid: Composition
) -> Float32[np.ndarray, "x y z"]:
    """The field outside of another solid, save where it was measured."""
    other, top = solid.evidence, np.array(grid.state.shape)
    ends = (other.origin - grid.origin, other.origin - grid.origin + other.voxel * (np.array(other.state.shape) - 1))
    first = np.maximum(np.ceil(ends[0] / grid.voxel).astype(int), 0)
    last = np.minimum(np.floor(ends[1] / grid.voxel).astype(int) + 1, top)
    if not (first < last).all():
        return distance
    box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    near = np.argwhere((grid.state[box] != Evidence.SURFACE) & (distance[box] < BAND)) + first
    at = (grid.origin + near * grid.voxel - other.origin) / other.voxel
    taken = -ndimage.map_coordinates(solid.distance, at.T, order=1, mode="nearest") * (other.voxel / grid.voxel)
    result, row = distance.copy(), tuple(near.T)
    result[row] = np.clip(np.maximum(distance[row], taken), -BAND, BAND)
    return result


def _heights(plane: HalfSpace, grid: EvidenceGrid) -> Float32[np.ndarray, "x y z"]:
    """Signed distance of every voxel from a plane, voxels, positive in front."""
    x, y, z = (plane.normal[axis] * np.arange(count) for axis, count in enumerate(grid.state.shape))
    first = (float(plane.normal @ grid.origin) - plane.offset) / grid.voxel
    return ((first + x)[:, None, None] + y[:, None] + z).astype(np.float32)


def _column(
    imprint: Imprint, grid: EvidenceGrid, wanted: Bool[np.ndarray, "x y z"]
) -> tuple[Int64[np.ndarray, "n 3"], Float32[np.ndarray, "n"]]:
    """Wanted voxels within an imprint's outline, from `_LID` below the plane up, and their height above it, voxels."""
    height = _heights(imprint.plane, grid)
    at = np.argwhere(wanted & (height > -_LID))
    at = at[imprint.holds(grid.origin + at * grid.voxel, _RIM * grid.voxel)]
    return at, height[tuple(at.T)]


def _in_front(mesh: Mesh, plane: HalfSpace, least: float) -> Mesh:
    """The part of a mesh that is at least so far in front of a plane; all of it, where nothing would be left."""
    kept = plane.depth(mesh.vertices) >= least
    if kept.all() or not kept.any():
        return mesh
    number = np.cumsum(kept, dtype=np.int32) - 1
    return Mesh(
        vertices=mesh.vertices[kept],
        faces=number[mesh.faces[kept[mesh.faces].all(axis=1)]].astype(np.int32),
        colours=None if mesh.colours is None else mesh.colours[kept],
    )


def _imprint(item: SceneObject) -> Imprint | None:
    """The outline in which an object stands: the convex hull of what was measured of its lowest part."""
    if item.contact is None or item.observed is None:
        return None
    plane = item.contact.plane
    height = plane.depth(item.observed.mesh.vertices)
    low = float(np.quantile(height, _LOWEST))
    foot = item.observed.mesh.vertices[height <= low + _FOOT_SHARE * (float(height.max()) - low)]
    across = np.linalg.svd(plane.normal[None])[2][1:]
    try:
        hull = ConvexHull(foot.astype(np.float64) @ across.T)
    except (QhullError, ValueError):
        return None
    return Imprint(plane=plane, axes=across, outline=hull.equations.astype(np.float64))
