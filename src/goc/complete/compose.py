"""One closed surface from what was measured and what was filled in: measurement wins."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8
from scipy import ndimage

from goc.complete.colours import inpainted, with_measured_colours
from goc.complete.hull import BAND, evidence_hull, neighbour_mean, relaxed
from goc.geometry.isosurface import grid_surface
from goc.scene import Evidence, EvidenceGrid, FlaggedMesh, HalfSpace, Mesh

_MARGIN = 2
"""Empty voxels put round the evidence, so that every surface closes inside the grid."""
_SEAM = 3.0
"""Voxels within which the filled surface bends to meet the measured one."""
_SEAM_ROUNDS = 12
_LEAST_SHARE = 0.02
"""Share of the measured surface that a piece must carry to be a part of the object."""
_NARROWEST = 0.03
"""Gaps narrower than this share of the grid's longest side count as closed: networks are not that sharp where
nothing was seen (docs/decisions/0031)."""
_OUTSIDE_LINKS = ndimage.generate_binary_structure(3, 2)
"""Connectivity of outside voxels, over faces and edges: marching cubes here separates inside corners that touch
across an edge only, and so connects outside corners that do."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """What completion starts from: what was measured of one object."""

    mesh: Mesh
    """Open surface with colours; of a point cloud, its points without faces."""
    evidence: EvidenceGrid
    """What is known of the box round it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Composition:
    """The signed distance field whose zero level is the completed object."""

    distance: Float32[np.ndarray, "x y z"]
    """Voxels, positive outside; its outermost layers are outside."""
    evidence: EvidenceGrid
    """The evidence on the same grid."""
    planes: tuple[HalfSpace, ...] = ()
    """What it was cut at: vertices on them stay there."""


def with_margin(evidence: EvidenceGrid, margin: int = _MARGIN) -> EvidenceGrid:
    """The same evidence in a grid that is larger by `margin` empty voxels on each side."""
    return replace(
        evidence,
        origin=evidence.origin - margin * evidence.voxel,
        state=np.pad(evidence.state, margin, constant_values=int(Evidence.EMPTY)),
        sdf=np.pad(evidence.sdf, margin),
    )


def compose_field(
    evidence: EvidenceGrid,
    fill: Float32[np.ndarray, "x y z"] | None,
    seen: Float32[np.ndarray, "v 3"],
    hull: Float32[np.ndarray, "x y z"] | None = None,
) -> Composition:
    """One signed field: measured distance where the surface was seen, outside where rays passed, the fill elsewhere.

    Args:
        evidence: with a margin, see `with_margin`.
        fill: a model's signed distance at the voxels, in voxels, positive outside; valid wherever the evidence is
            unknown or surface. None: everything that is not seen empty is solid (the evidence hull).
        seen: vertices of the measured surface, world: tell which pieces are parts of the object.
        hull: `evidence_hull(evidence)`, where it is known already.

    Returns:
        Measured voxels have their measured sign, save in pieces that were dropped and in holes that were closed:
        pieces with next to no measured surface, and hollows that nothing outside leads to. Space that a model left
        free behind gaps too narrow for it to know of is solid.
    """
    distance = evidence_hull(evidence) if hull is None else hull
    if fill is not None:
        distance = _filled(distance, np.clip(fill, -BAND, BAND).astype(np.float32), evidence)
    distance = np.where(np.abs(distance) < 1e-3, np.float32(1e-3), distance)  # zero has no side
    if fill is not None:
        distance = without_pockets(distance, evidence.state)
    distance = without_floaters(distance, _voxels_of(seen, evidence))
    return Composition(distance=without_cavities(distance), evidence=evidence)


def compose(found: Measured, fill: Float32[np.ndarray, "x y z"] | None) -> FlaggedMesh:
    """A closed mesh from a measured one: see `compose_field`; its vertices are observed or completed.

    Args:
        found: any frame.
        fill: at the voxels of `with_margin(found.evidence)`; None for the hull.

    Returns:
        A watertight mesh (empty if there is no inside at all) in the frame and units given; `observed` where a vertex
        lies in the measured band. Colours are carried over from the nearest measured ones and spread from there.
    """
    return closed_surface(compose_field(with_margin(found.evidence), fill, found.mesh.vertices), found.mesh)


def closed_surface(composed: Composition, seen: Mesh) -> FlaggedMesh:
    """The zero level of a composed field: vertices flagged by what was measured, coloured after the seen mesh."""
    return inpainted(with_measured_colours(bare_surface(composed), seen))


def bare_surface(composed: Composition) -> FlaggedMesh:
    """The zero level of a composed field without colours: vertices flagged by what was measured."""
    grid = composed.evidence
    vertices, faces = grid_surface(composed.distance, grid.origin, grid.voxel)
    return FlaggedMesh(mesh=Mesh(vertices=vertices, faces=faces), observed=_measured(vertices, grid))


def without_floaters(
    distance: Float32[np.ndarray, "x y z"], seen: Int32[np.ndarray, "v 3"]
) -> Float32[np.ndarray, "x y z"]:
    """Drop pieces that carry next to no measured surface; the one that carries most (or is largest) always stays.

    Args:
        distance: voxels, positive outside.
        seen: voxels at which surface was measured; an inside voxel next to one is reached by it.
    """
    pieces, count = ndimage.label(distance < 0)
    if count <= 1:
        return distance
    reached = np.zeros(len(seen), pieces.dtype)
    for step in np.ndindex(3, 3, 3):
        at = np.clip(seen + np.array(step) - 1, 0, np.array(distance.shape) - 1)
        reached = np.maximum(reached, pieces[tuple(at.T)])
    votes = np.bincount(reached, minlength=count + 1)[1:]
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)[1:]
    keep = votes >= max(1.0, _LEAST_SHARE * len(seen))
    keep[np.lexsort((sizes, votes))[-1]] = True
    dropped = np.concatenate([[False], ~keep])[pieces]
    return np.where(dropped, -distance, distance)


def without_pockets(
    distance: Float32[np.ndarray, "x y z"], state: UInt8[np.ndarray, "x y z"]
) -> Float32[np.ndarray, "x y z"]:
    """Make guessed free space solid that only narrow gaps connect to space that rays passed; seen-empty stays empty.

    A network that is unsure behind a wall leaves pockets there, and crevices of a few voxels connect these to the
    outside, so that `without_cavities` does not fill them.

    Args:
        distance: voxels, positive outside.
        state: Evidence; only unknown voxels are filled.
    """
    air, passed = distance > 0, state == Evidence.EMPTY
    guessed = air & (state == Evidence.UNKNOWN)
    side = 2 * (max(3, round(_NARROWEST * max(state.shape))) // 2) + 1
    wide = ndimage.minimum_filter(air, size=side) | (air & passed)
    rooms, count = ndimage.label(wide, _OUTSIDE_LINKS)
    joined = np.zeros(count + 1, bool)
    joined[rooms[passed & air]] = True
    reached = ndimage.maximum_filter(joined[rooms], size=side)
    return np.where(guessed & ~reached, -distance, distance)


def without_cavities(distance: Float32[np.ndarray, "x y z"]) -> Float32[np.ndarray, "x y z"]:
    """Make enclosed cavities solid: outside voxels that are not connected to the border of the grid."""
    rooms, _ = ndimage.label(distance > 0, _OUTSIDE_LINKS)
    hollow = (rooms > 0) & (rooms != rooms[0, 0, 0])
    return np.where(hollow, -distance, distance)


def _filled(
    hull: Float32[np.ndarray, "x y z"], fill: Float32[np.ndarray, "x y z"], evidence: EvidenceGrid
) -> Float32[np.ndarray, "x y z"]:
    """The fill within the hull, bent to meet the measured surface within `_SEAM` voxels of it."""
    seen, empty = evidence.state == Evidence.SURFACE, evidence.state == Evidence.EMPTY
    unknown = ~seen & ~empty
    gap = np.where(seen, hull - fill, np.float32(0))
    spread = gap
    keep = np.float32(6.0 / (6.0 + 1.0 / _SEAM**2))
    for _ in range(_SEAM_ROUNDS):
        spread = np.where(seen, gap, np.where(unknown, keep * neighbour_mean(spread), np.float32(0)))
    inner = np.where(unknown, np.maximum(hull, fill + spread), hull)
    return relaxed(inner, seen, empty, rounds=2)


def _voxels_of(points: Float32[np.ndarray, "v 3"], grid: EvidenceGrid) -> Int32[np.ndarray, "v 3"]:
    """The voxel each point lies in; points beyond the grid count at its border."""
    at = np.rint((points - grid.origin) / grid.voxel).astype(np.int32)
    return np.clip(at, 0, np.array(grid.state.shape, np.int32) - 1)


def _measured(vertices: Float32[np.ndarray, "v 3"], grid: EvidenceGrid) -> Bool[np.ndarray, "v"]:
    """Which vertices were measured. Each lies on an edge of the grid, between an inner and an outer voxel.

    Both voxels are in the measured band; or one is, within a voxel of the surface, and rays passed the other.
    """
    at = (vertices - grid.origin) / grid.voxel
    top = np.array(grid.state.shape) - 1
    ends = [np.clip(end, 0, top) for end in (np.floor(at + 1e-3).astype(np.int64), np.ceil(at - 1e-3).astype(np.int64))]
    seen, empty, near = (
        [field[tuple(end.T)] for end in ends]
        for field in (
            grid.state == Evidence.SURFACE,
            grid.state == Evidence.EMPTY,
            (grid.state == Evidence.SURFACE) & (np.abs(grid.sdf) < grid.voxel),
        )
    )
    return (seen[0] & seen[1]) | (near[0] & empty[1]) | (empty[0] & near[1])
