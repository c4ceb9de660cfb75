"""Horizontal faces that may carry other things: table tops, counters, shelves, seats."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.ndimage import binary_closing, binary_dilation, binary_erosion, binary_fill_holes

from goc.geometry.planes import Plane, find_plane, spread
from goc.geometry.voxels import parts_of
from goc.segment.config import SegmentConfig
from goc.segment.fuse import Surface
from goc.segment.room import LEVEL, Room

LOWEST_M = 0.2
"""A face lower than this above the floor carries nothing: it is a plinth, a rug, a foot."""
RIM_M = 0.04
"""A face may reach so far beyond where it was recognised, metres."""
FLAT_M = 0.02
"""A face is at most so uneven, metres to either side."""
APART_M = 0.15
"""Of two faces closer than this, one above the other, metres, the upper is the top of a thing on the lower."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """Cells of the ground, on a small raster."""

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
        """With everything within so many cells; -n shrinks."""
        if cells < 0:
            return Footprint(self.origin, binary_erosion(self.mask, iterations=-cells))
        mask = np.pad(self.mask, cells)
        return Footprint(self.origin - cells, binary_dilation(mask, iterations=cells) if cells else mask)

    def rim(self) -> Int64[np.ndarray, "q 2"]:
        """Cells at its border."""
        return np.argwhere(self.mask & ~binary_erosion(self.mask)) + self.origin


@dataclass(frozen=True, eq=False)
class Support:
    """A horizontal face, and what it lies over."""

    plane: Plane
    rows: Int64[np.ndarray, "m"]
    footprint: Footprint
    """Holes filled: what stands on the face hides it."""


def ground_cells(points: Float[np.ndarray, "v 3"], up: Float[np.ndarray, "3"], voxel: float) -> Int64[np.ndarray, "v 2"]:
    """The cell of the horizontal plane over which each point lies."""
    east = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    east /= np.linalg.norm(east)
    return np.floor(np.stack([points @ east, points @ np.cross(up, east)], 1) / voxel).astype(np.int64)


def footprint_of(cells: Int64[np.ndarray, "m 2"]) -> Footprint:
    """The cells, small gaps closed and holes filled."""
    margin = 2
    origin = cells.min(0) - margin
    mask = np.zeros(np.ptp(cells, axis=0) + 1 + 2 * margin, bool)
    mask[tuple((cells - origin).T)] = True
    return Footprint(origin, binary_fill_holes(binary_closing(mask, iterations=margin) | mask))


def reach_of(support: Support, surface: Surface, unit: float) -> Footprint:
    """The footprint of a support with its rim, which may be rounded, or blurred by drift."""
    return support.footprint.grown(max(1, round(RIM_M * unit / surface.voxel)))


def find_supports(
    surface: Surface,
    room: Room,
    cells: Int64[np.ndarray, "v 2"],
    config: SegmentConfig,
    unit: float,
    rng: np.random.Generator,
) -> list[Support]:
    """Connected horizontal planes among what is not room, of at least `min_support_m2`, above knee-deep things."""
    heights = surface.points @ room.up if room.floor is None else room.floor.distance(surface.points)
    free = ~room.mask if room.floor is None else ~room.mask & (heights > LOWEST_M * unit)
    level = free & (surface.normals @ room.up > LEVEL)
    parts = parts_of(surface.keys, level, 1.8)
    needed = config.min_support_m2 * (unit / surface.voxel) ** 2
    sizes = np.bincount(parts[level]) if level.any() else np.zeros(0, np.int64)
    found: list[Support] = []
    for part in sorted(np.flatnonzero(sizes >= needed), key=lambda part: -sizes[part]):
        left = np.flatnonzero(parts == part)
        while len(left) >= needed:
            plane = find_plane(surface.points[left], surface.normals[left], 0.75 * surface.voxel, rng, trials=60)
            if plane is None or plane.normal @ room.up < LEVEL:
                break
            distance = np.abs(plane.distance(surface.points[left]))
            near = 3.0 * spread(distance[distance < max(2 * surface.voxel, FLAT_M * unit)])
            near = max(0.75 * surface.voxel, min(near, FLAT_M * unit))
            mine = left[distance <= near]
            if len(mine) < needed:
                break
            left = np.setdiff1d(left, mine)
            footprint = footprint_of(cells[mine])
            layer = np.flatnonzero(free & (np.abs(plane.distance(surface.points)) <= near))
            layer = layer[footprint.holds(cells[layer])]
            layer = np.setdiff1d(layer, np.concatenate([support.rows for support in found])) if found else layer
            left = np.setdiff1d(left, layer)
            if len(layer) >= needed and not _lies_on(plane, cells[layer], surface, unit, found):
                found.append(Support(plane, layer, footprint))
    return found


def _lies_on(
    plane: Plane, cells: Int64[np.ndarray, "m 2"], surface: Surface, unit: float, supports: list[Support]
) -> bool:
    """Whether a face lies over a larger one at less than a hand's height: the top of a thing that stands there."""
    for support in supports:
        height = plane.offset - support.plane.offset
        if 0 < height < APART_M * unit and support.footprint.holds(cells).mean() > 0.5:
            return True
    return False
