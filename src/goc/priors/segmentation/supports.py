"""Horizontal faces that may carry other things: table tops, counters, shelves, seats."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.ndimage import binary_closing, binary_dilation, binary_erosion, binary_fill_holes

from goc.geometry.gravity import LEVEL
from goc.geometry.planes import Plane, along, find_plane, robust_sigma
from goc.geometry.voxels import parts_of
from goc.priors.segmentation.config import SegmentConfig
from goc.priors.segmentation.room_planes import RoomPlanes
from goc.priors.segmentation.surface_voxels import SurfaceVoxels

LOWEST_M = 0.2
"""A face lower than this above the floor carries nothing: it is a plinth, a rug, a foot."""
BELOW = 0.75
"""What lies up to so many voxels over a face counts as below: its own thickness."""
RIM_M = 0.04
"""A face may reach so far beyond where it was recognised, metres."""
FLAT_M = 0.02
"""A face is at most so uneven, metres to either side."""
APART_M = 0.15
"""Of two faces closer than this, one above the other, metres, the upper is the top of a thing on the lower."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """A set of cells of the horizontal plane, as a mask with an origin."""

    origin: Int64[np.ndarray, "2"]
    mask: Bool[np.ndarray, "x y"]

    def holds(self, cells: Int64[np.ndarray, "p 2"]) -> Bool[np.ndarray, "p"]:
        """Whether each cell is one of them."""
        local = cells - self.origin
        inside = ((local >= 0) & (local < self.mask.shape)).all(1)
        held = np.zeros(len(cells), bool)
        held[inside] = self.mask[local[inside, 0], local[inside, 1]]
        return held

    def grown(self, cells: int) -> "Footprint":
        """With everything within so many steps, at least one."""
        return Footprint(self.origin - cells, binary_dilation(np.pad(self.mask, cells), iterations=cells))

    def rim(self) -> Int64[np.ndarray, "q 2"]:
        """Cells at its border."""
        return np.argwhere(self.mask & ~binary_erosion(self.mask)) + self.origin


@dataclass(frozen=True, eq=False)
class Support:
    """A horizontal face that may carry objects: its plane, its voxels, and the cells it covers."""

    plane: Plane
    rows: Int64[np.ndarray, "m"]
    footprint: Footprint
    """Holes filled: what stands on the face hides it."""


def ground_cells(
    points: Float[np.ndarray, "v 3"], up: Float[np.ndarray, "3"], voxel: float
) -> Int64[np.ndarray, "v 2"]:
    """The cell of the horizontal plane over which each point lies."""
    east = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    east /= np.linalg.norm(east)
    return np.floor(np.stack([along(points, east), along(points, np.cross(up, east))], 1) / voxel).astype(np.int64)


def footprint_of(cells: Int64[np.ndarray, "m 2"]) -> Footprint:
    """The cells, small gaps closed and holes filled."""
    margin = 2
    origin = cells.min(0) - margin
    mask = np.zeros(np.ptp(cells, axis=0) + 1 + 2 * margin, bool)
    mask[tuple((cells - origin).T)] = True
    return Footprint(origin, binary_fill_holes(binary_closing(mask, iterations=margin) | mask))


def reach_of(support: Support, surface: SurfaceVoxels, units_per_metre: float) -> Footprint:
    """The footprint of a support with its rim, which may be rounded, or blurred by drift."""
    return support.footprint.grown(max(1, round(RIM_M * units_per_metre / surface.voxel)))


def find_supports(
    surface: SurfaceVoxels,
    room: RoomPlanes,
    cells: Int64[np.ndarray, "v 2"],
    config: SegmentConfig,
    units_per_metre: float,
    rng: np.random.Generator,
) -> list[Support]:
    """Connected horizontal planes among what is not room, of at least `min_support_m2`, above knee-deep things."""
    free = ~room.mask
    if room.floor is not None:
        free &= room.floor.distance(surface.points) > LOWEST_M * units_per_metre
    level = free & (along(surface.normals, room.up) > LEVEL)
    parts = parts_of(surface.keys, level, 1.8)
    sizes = np.bincount(parts[level], minlength=1)
    needed = config.min_support_m2 * (units_per_metre / surface.voxel) ** 2
    found: list[Support] = []
    for part in np.argsort(-sizes, kind="stable")[: (sizes >= needed).sum()]:
        left = np.flatnonzero(parts == part)
        while len(left) >= needed:
            face = _largest_face(surface, left, free, cells, room.up, units_per_metre, rng)
            if face is None or len(face.rows) < needed:
                break
            left = np.setdiff1d(left, face.rows)
            free[face.rows] = False
            if not _lies_on(face, cells, units_per_metre, found):
                found.append(face)
    return found


def _largest_face(
    surface: SurfaceVoxels,
    rows: Int64[np.ndarray, "m"],
    free: Bool[np.ndarray, "v"],
    cells: Int64[np.ndarray, "v 2"],
    up: Float[np.ndarray, "3"],
    units_per_metre: float,
    rng: np.random.Generator,
) -> Support | None:
    """The largest horizontal plane among some voxels, with all that is free in its layer over its footprint."""
    plane = find_plane(surface.points[rows], surface.normals[rows], 0.75 * surface.voxel, rng, trials=60)
    if plane is None or plane.normal @ up < LEVEL:
        return None
    distance = plane.distance(surface.points[rows])
    noise = robust_sigma(distance[np.abs(distance) < max(2 * surface.voxel, FLAT_M * units_per_metre)])
    near = max(0.75 * surface.voxel, min(3.0 * noise, FLAT_M * units_per_metre))
    mine = rows[np.abs(distance) <= near]
    if not len(mine):
        return None
    footprint = footprint_of(cells[mine])
    layer = np.flatnonzero(free & (np.abs(plane.distance(surface.points)) <= near))
    return Support(plane, np.union1d(mine, layer[footprint.holds(cells[layer])]), footprint)


def _lies_on(face: Support, cells: Int64[np.ndarray, "v 2"], units_per_metre: float, supports: list[Support]) -> bool:
    """Whether a face lies over a larger one at less than a hand's height: the top of a thing that stands there."""
    for support in supports:
        height = face.plane.offset - support.plane.offset
        if 0 < height < APART_M * units_per_metre and support.footprint.holds(cells[face.rows]).mean() > 0.5:
            return True
    return False
