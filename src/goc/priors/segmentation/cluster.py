"""Groups voxels that are not room into objects, and separates what stands on a support from the support."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int64

from goc.geometry.voxels import connected_parts, neighbour_pairs
from goc.priors.segmentation.config import SegmentConfig
from goc.priors.segmentation.part_merging import PartGraph
from goc.priors.segmentation.room_planes import RoomPlanes
from goc.priors.segmentation.supports import BELOW, Support, find_supports, ground_cells, reach_of
from goc.priors.segmentation.surface_voxels import SurfaceVoxels
from goc.scene import ROOM, UNLABELLED

CONNECTED = 1.8
"""Voxels this many cells apart are one part: all 26 neighbours."""
TOP_M = 0.05
"""What rises less above a face, metres, is its rim."""
OPEN_BELOW = 1.0
"""Voxels below a table's top, as a share of those of the top, are fewer than this; a cupboard has more."""
TOUCHING = 2.3
"""PartGraph whose voxels come this many cells near each other touch."""


@dataclass(frozen=True, eq=False)
class SegmentedObjects:
    """The id of each voxel (0 = room, 1… objects, -1 = none), and a name for each object."""

    ids: Int64[np.ndarray, "v"]
    id_names: dict[int, str]


def find_objects(
    surface: SurfaceVoxels, room: RoomPlanes, config: SegmentConfig, units_per_metre: float, rng: np.random.Generator
) -> SegmentedObjects:
    """Ids of all voxels: 0 = room, 1… objects by falling size, -1 = too small.

    Connected voxels are one thing, but for two cuts at every horizontal face that could be a support: the face itself
    is taken out, which frees what stands on it, and the column below it is cut off, which frees what stands beside it.
    Then what carries a face is joined to it again.
    """
    if room.mask.all():
        return SegmentedObjects(np.zeros(len(surface), np.int64), {})
    cells = ground_cells(surface.points, room.up, surface.voxel)
    supports = find_supports(surface, room, cells, config, units_per_metre, rng)
    column = _columns(surface, supports, cells, units_per_metre)
    ids = _cut(surface, ~room.mask, supports, column)
    a, b = neighbour_pairs(surface.keys, TOUCHING)
    a, b = np.concatenate([a, b]), np.concatenate([b, a])
    grounded = np.bincount(ids[a[(ids[a] >= 0) & room.mask[b]]], minlength=int(ids.max(initial=-1)) + 1) > 0
    touching = (ids[a] >= 0) & (ids[b] >= 0) & (ids[a] != ids[b])
    a, b = a[touching], b[touching]
    things = PartGraph(surface, room, units_per_metre, supports, ids, column, cells, (a, b), grounded).merged()
    return _order(surface, things, supports, config, units_per_metre)


def _columns(
    surface: SurfaceVoxels, supports: list[Support], cells: Int64[np.ndarray, "v 2"], units_per_metre: float
) -> Bool[np.ndarray, "v"]:
    """Whether each voxel lies below some support or its rim."""
    column = np.zeros(len(surface), bool)
    for support in supports:
        below = support.plane.distance(surface.points) < BELOW * surface.voxel
        column |= below & reach_of(support, surface, units_per_metre).holds(cells)
    return column


def _cut(
    surface: SurfaceVoxels, free: Bool[np.ndarray, "v"], supports: list[Support], column: Bool[np.ndarray, "v"]
) -> Int64[np.ndarray, "v"]:
    """Connected parts of what is free, cut at supports and below their rims; the supports follow. -1 where not free."""
    body = free.copy()
    for support in supports:
        body[support.rows] = False
    rows = np.flatnonzero(body)
    a, b = neighbour_pairs(surface.keys[rows], CONNECTED)
    same = column[rows[a]] == column[rows[b]]
    ids = np.full(len(surface), -1, np.int64)
    ids[rows] = connected_parts(len(rows), a[same], b[same])
    count = int(ids.max(initial=-1)) + 1
    for number, support in enumerate(supports):
        ids[support.rows] = count + number
    return ids


def _order(
    surface: SurfaceVoxels,
    things: Int64[np.ndarray, "v"],
    supports: list[Support],
    config: SegmentConfig,
    units_per_metre: float,
) -> SegmentedObjects:
    """Drop objects that are too small, and number the others by falling size."""
    ids = np.where(things >= 0, UNLABELLED, ROOM).astype(np.int64)
    sizes = np.bincount(things[things >= 0]) if (things >= 0).any() else np.zeros(0, int)
    least = max(8.0, 2.0 * (config.min_object_m * units_per_metre / surface.voxel) ** 2)
    number, names = 0, {}
    for thing in np.argsort(-sizes, kind="stable")[: (sizes >= least).sum()]:
        rows = np.flatnonzero(things == thing)
        if np.ptp(surface.points[rows], axis=0).max() < config.min_object_m * units_per_metre:
            continue
        number += 1
        ids[rows] = number
        faces = [support for support in supports if things[support.rows[0]] == thing]
        names[number] = "table" if _is_table(faces, surface, rows, units_per_metre) else f"object {number}"
    return SegmentedObjects(ids, names)


def _is_table(
    faces: list[Support], surface: SurfaceVoxels, rows: Int64[np.ndarray, "m"], units_per_metre: float
) -> bool:
    """Whether one of a thing's faces is its top, nothing rising past it, and there is little but legs below."""
    for face in faces:
        height = face.plane.distance(surface.points[rows])
        risen = (height > TOP_M * units_per_metre).mean()
        below = (height < -TOP_M * units_per_metre).sum() / len(face.rows)
        if risen < 0.02 and below < OPEN_BELOW:
            return True
    return False
