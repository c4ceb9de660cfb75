"""Sparse voxel grids as sorted integer keys: grouping, adjacency, connected parts."""

import numpy as np
from jaxtyping import Bool, Float, Int, Int64, Shaped
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

AXIS_BITS = 21
HALF = 1 << (AXIS_BITS - 1)
"""Cells on either side of the origin along each axis."""


def pack_cells(cells: Int[np.ndarray, "p 3"]) -> Int64[np.ndarray, "p"]:
    """One integer a cell; a neighbour's key is the key plus `pack_offset` of the step.

    Raises:
        ValueError: a cell lies more than 2^20 - 4 cells from the origin.
    """
    if cells.size and np.abs(cells).max() > HALF - 4:
        raise ValueError(f"cells reach {np.abs(cells).max()} from the origin; keys hold {HALF - 4}")
    wide = cells.astype(np.int64) + HALF
    return wide[:, 0] + (wide[:, 1] << AXIS_BITS) + (wide[:, 2] << (2 * AXIS_BITS))


def unpack_cells(keys: Int64[np.ndarray, "p"]) -> Int64[np.ndarray, "p 3"]:
    """The cells that `pack_cells` packed."""
    mask = (1 << AXIS_BITS) - 1
    return np.stack([keys & mask, (keys >> AXIS_BITS) & mask, keys >> (2 * AXIS_BITS)], 1) - HALF


def pack_offset(step: tuple[int, int, int]) -> int:
    """Difference of keys between a cell and the one `step` away."""
    return step[0] + step[1] * (1 << AXIS_BITS) + step[2] * (1 << (2 * AXIS_BITS))


def cells_of(points: Float[np.ndarray, "p 3"], voxel: float) -> Int64[np.ndarray, "p 3"]:
    """The cell that holds each point; cell (0, 0, 0) spans [0, voxel)³."""
    return np.floor(points / voxel).astype(np.int64)


def sum_by_key(
    keys: Int64[np.ndarray, "p"], values: Float[np.ndarray, "p c"]
) -> tuple[Int64[np.ndarray, "v"], Float[np.ndarray, "v c"]]:
    """Sorted unique keys, and the sum of the values of each. Equal keys are summed in the order given."""
    order = np.argsort(keys, kind="stable")
    ranked = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ranked[1:] != ranked[:-1]])) if len(keys) else np.zeros(0, int)
    return ranked[starts], np.add.reduceat(values[order], starts, 0) if len(keys) else values


def find_keys(keys: Int64[np.ndarray, "v"], wanted: Int64[np.ndarray, "p"]) -> Int64[np.ndarray, "p"]:
    """Row of each wanted key in the sorted keys, -1 where it is not there."""
    if not len(keys):
        return np.full(len(wanted), -1, np.int64)
    rows = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[rows] == wanted, rows, -1)


def ball(radius: float) -> list[tuple[int, int, int]]:
    """Steps of at most `radius` cells, nearest first, without the null step."""
    reach = range(-int(radius), int(radius) + 1)
    steps = [(x, y, z) for x in reach for y in reach for z in reach if 0 < x * x + y * y + z * z <= radius * radius]
    return sorted(steps, key=lambda step: (step[0] ** 2 + step[1] ** 2 + step[2] ** 2, step))


def neighbour_pairs(
    keys: Int64[np.ndarray, "v"], radius: float
) -> tuple[Int64[np.ndarray, "e"], Int64[np.ndarray, "e"]]:
    """Rows of all pairs of sorted, unique keys whose cells are at most `radius` cells apart, each pair once."""
    firsts, seconds = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for step in ball(radius):
        offset = pack_offset(step)
        if offset > 0:
            rows = find_keys(keys, keys + offset)
            hit = np.flatnonzero(rows >= 0)
            firsts.append(hit)
            seconds.append(rows[hit])
    return np.concatenate(firsts), np.concatenate(seconds)


def connected_parts(
    count: int, firsts: Int64[np.ndarray, "e"], seconds: Int64[np.ndarray, "e"]
) -> Int64[np.ndarray, "{count}"]:
    """Number of the connected part of each of `count` nodes, counted in the order of the parts' first nodes."""
    links = coo_array((np.ones(len(firsts), np.int8), (firsts, seconds)), shape=(count, count))
    _, parts = connected_components(links, directed=False)
    _, first_rows, inverse = np.unique(parts, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first_rows))[inverse].astype(np.int64)


def parts_of(keys: Int64[np.ndarray, "v"], chosen: Bool[np.ndarray, "v"], radius: float) -> Int64[np.ndarray, "v"]:
    """Connected part of each chosen voxel, steps up to `radius` cells; -1 where not chosen."""
    rows = np.flatnonzero(chosen)
    parts = np.full(len(keys), -1, np.int64)
    parts[rows] = connected_parts(len(rows), *neighbour_pairs(keys[rows], radius))
    return parts


def dilate(
    keys: Int64[np.ndarray, "v"], values: Shaped[np.ndarray, "v"], rounds: int
) -> tuple[Int64[np.ndarray, "w"], Shaped[np.ndarray, "w"]]:
    """Fill empty cells with the value of a filled one among their 26 neighbours; `rounds` times over.

    Axis by axis, which needs little memory: a neighbour along an earlier axis wins, and of two the one below.
    """
    for _ in range(rounds):
        for step in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
            offset = pack_offset(step)
            grown, first_rows = np.unique(np.concatenate([keys, keys + offset, keys - offset]), return_index=True)
            keys, values = grown, values[first_rows % len(keys)]
    return keys, values
