"""Where surfaces are, coarsely: space cells that pixels hit, by id. It tells what to allocate and how big things are."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32, Int64
from scipy import ndimage

from goc import _native
from goc.extract.depth import DepthView

_BITS = 16
_BIAS = 1 << (_BITS - 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells:
    """Distinct (id, cell) pairs with the number of pixels that fell there."""

    size: float
    """Edge of a cell, scene units; cell (0, 0, 0) has its lower corner at the world's origin."""
    ids: Int32[np.ndarray, "n"]
    index: Int32[np.ndarray, "n 3"]
    hits: Int64[np.ndarray, "n"]


def count_cells(views: Iterable[DepthView], size: float, by_id: bool) -> Cells:
    """Count pixels a cell and id over all views; without by_id every pixel counts as id 0."""
    keys, hits = np.zeros(0, np.uint64), np.zeros(0, np.int64)
    pending: list[tuple[np.ndarray, np.ndarray]] = []
    for view in views:
        ids = view.ids if by_id else None
        key, hit = _native.count_cells(view.depth, view.slope, ids, view.pinhole, view.world_from_cam, size)
        pending.append((key[:, 0], hit[:, 0]))
        if sum(len(key) for key, _ in pending) > 4_000_000:
            keys, hits = _merge([(keys, hits), *pending])
            pending = []
    keys, hits = _merge([(keys, hits), *pending])
    shifts = np.array([3, 2, 1, 0], np.uint64) * np.uint64(_BITS)
    columns = (keys[:, None] >> shifts & np.uint64((1 << _BITS) - 1)).astype(np.int32) - _BIAS
    return Cells(size=size, ids=columns[:, 0], index=np.ascontiguousarray(columns[:, 1:]), hits=hits)


def object_cells(cells: Cells, wanted: int, least_share: float = 0.3) -> Int32[np.ndarray, "n 3"]:
    """Cells that belong to one object: pixels of its id are a fair share there, and the piece they form is no crumb.

    Ids that flicker at silhouettes stain what lies behind; there the other views outvote them.
    """
    totals = _totals(cells)
    own = (cells.ids == wanted) & (cells.hits >= least_share * totals)
    index, hits = cells.index[own], cells.hits[own]
    if len(index) == 0:
        return index
    piece = _pieces(index)
    weight = np.bincount(piece, weights=hits)
    return index[(weight >= 0.005 * weight.max())[piece]]


def _merge(counted: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    keys, inverse = np.unique(np.concatenate([key for key, _ in counted]), return_inverse=True)
    hits = np.bincount(inverse, weights=np.concatenate([hit for _, hit in counted]), minlength=len(keys))
    return keys, hits.astype(np.int64)


def _totals(cells: Cells) -> Int64[np.ndarray, "n"]:
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
