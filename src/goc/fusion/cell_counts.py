"""Coarse cells of space that pixels hit, counted by id: where to allocate voxels, and how large each object is."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32, Int64
from scipy import ndimage

from goc import _native
from goc.fusion.depth_views import DepthView
from goc.geometry.native_camera import native_camera

_BITS = 16
_BIAS = 1 << (_BITS - 1)
_MERGE_AT = 4_000_000
"""Entries that may wait to be merged: 100 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CellCounts:
    """Distinct (id, cell) pairs with the number of pixels that fell there."""

    size: float
    """Edge of a cell, scene units; cell (0, 0, 0) has its lower corner at the world's origin."""
    ids: Int32[np.ndarray, "n"]
    index: Int32[np.ndarray, "n 3"]
    hits: Int64[np.ndarray, "n"]
    """Pixels, over all views."""
    views: Int64[np.ndarray, "n"]
    """Views with a pixel there."""


def count_cells(views: Iterable[DepthView], size: float, by_id: bool) -> CellCounts:
    """Count pixels and views a cell and id; without by_id every pixel counts as id 0."""
    merged = (np.zeros(0, np.uint64), np.zeros((0, 2), np.int64))
    pending = [merged]
    for view in views:
        ids = view.ids if by_id else None
        key, hits = _native.count_cells(view.depth, view.slope, ids, native_camera(view.camera), size)
        pending.append((key[:, 0], np.concatenate([hits, np.ones_like(hits)], axis=1)))
        if sum(len(key) for key, _ in pending[1:]) > _MERGE_AT:
            pending = [_merge(pending)]
    keys, counts = _merge(pending)
    shifts = np.array([3, 2, 1, 0], np.uint64) * np.uint64(_BITS)
    columns = (keys[:, None] >> shifts & np.uint64((1 << _BITS) - 1)).astype(np.int32) - _BIAS
    return CellCounts(
        size=size,
        ids=columns[:, 0],
        index=np.ascontiguousarray(columns[:, 1:]),
        hits=counts[:, 0],
        views=counts[:, 1],
    )


def object_cells(cells: CellCounts, wanted: int, least_share: float = 0.3) -> Int32[np.ndarray, "n 3"]:
    """Cells that belong to one object: pixels of its id are a fair share there, and the piece they form is not small.

    Wrong ids at silhouettes fall on what lies behind; there the pixels of other views are more.
    """
    totals = _totals(cells)
    own = (cells.ids == wanted) & (cells.hits >= least_share * totals)
    if own.any():
        own &= cells.views >= min(3, math.ceil(cells.views[own].max() / 20))  # flying pixels fly alone
    index, hits = cells.index[own], cells.hits[own]
    if len(index) == 0:
        return index
    piece = _pieces(index)
    weight = np.bincount(piece, weights=hits)
    return index[(weight >= 0.005 * weight.max())[piece]]


def _merge(counted: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    keys, inverse = np.unique(np.concatenate([key for key, _ in counted]), return_inverse=True)
    counts = np.concatenate([count for _, count in counted])
    sums = [np.bincount(inverse, weights=counts[:, column], minlength=len(keys)) for column in range(2)]
    return keys, np.stack(sums, axis=1).astype(np.int64)


def _totals(cells: CellCounts) -> Int64[np.ndarray, "n"]:
    """Pixels of every id in each entry's cell."""
    x, y, z = (cells.index.astype(np.int64) + _BIAS).T
    _, inverse = np.unique((x << 2 * _BITS) | (y << _BITS) | z, return_inverse=True)
    return np.bincount(inverse, weights=cells.hits).astype(np.int64)[inverse]


def _pieces(index: Int32[np.ndarray, "n 3"]) -> Int64[np.ndarray, "n"]:
    """Label of the connected piece each cell is in; gaps of one cell do not part."""
    low = index.min(axis=0) - 1
    halved = (index - low) // 2
    grid = np.zeros(halved.max(axis=0) + 1, bool)
    grid[tuple(halved.T)] = True
    labels, _ = ndimage.label(grid, np.ones((3, 3, 3)))
    return labels[tuple(halved.T)].astype(np.int64) - 1
