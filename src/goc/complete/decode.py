"""Evaluates an occupancy field on a grid, coarse to fine, only where its surface can be."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64

from goc.complete.hull import BAND
from goc.complete.partial import OccupancyField
from goc.errors import CompleteError

_STEEPEST = 20.0
"""Slopes of the log-odds are clipped at this change per voxel: beyond, both voxels are nearly certain."""


_BEYOND = -20.0
"""Log-odds assumed outside the model's cube: the object ends there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class QueryGrid:
    """The grid of voxel centres at which a field is evaluated, model units."""

    origin: Float64[np.ndarray, "3"]
    """Centre of voxel (0, 0, 0)."""
    voxel: float
    shape: tuple[int, int, int]


@dataclass(frozen=True, kw_only=True)
class Refinement:
    """How coarse the search for a field's surface begins, and where it is refined."""

    cells: int = 64
    """Least number of cells along the longest side at the coarsest level (where the grid has as many)."""
    enough: int = 1 << 20
    """Cells along the longest side beyond which the field is not evaluated; finer levels are interpolated."""
    band: float = 3.0
    """Cells with a corner of smaller |log-odds| are refined, even where all corners have the same sign."""


def decode(
    field: OccupancyField,
    grid: QueryGrid,
    refinement: Refinement,
    wanted: Bool[np.ndarray, "x y z"] | None = None,
    forced: Bool[np.ndarray, "x y z"] | None = None,
) -> Float32[np.ndarray, "x y z"]:
    """Log-odds at the voxels of a grid, coarse to fine.

    From one level to the next, cells are split whose corners disagree or are unsure, those that hold a forced voxel,
    and the neighbours of all these. What is not split takes its corners' mean, and so their sign.

    Args:
        field: asked only within [-1, 1]³, in chunks of its own choosing.
        grid: the finest level.
        refinement: where to start, what counts as unsure.
        wanted: voxels whose values matter; None: all. Cells without any are not split.
        forced: voxels in which surface is known to be, such as those of observed points.

    Raises:
        CompleteError: the field answers with something that is not finite.
    """
    coarsest = 2 ** max(0, math.floor(math.log2(max(grid.shape) / refinement.cells)))
    step = coarsest
    nodes = [max(1, math.ceil((n - 1) / coarsest)) + 1 for n in grid.shape]
    values = np.zeros(nodes, np.float32)
    asked = np.ones(nodes, bool)
    _ask(field, grid, step, asked, values)
    while step > 1:
        if max(grid.shape) / step >= refinement.enough:
            values, asked, step = _between(values), np.zeros(0, bool), step // 2
            continue
        split = _unsure(values, refinement.band)
        if forced is not None:
            split |= _holding(forced, step, split.shape)
        split = _grown(split)
        if wanted is not None:
            split &= _holding(wanted, step, split.shape)
        step //= 2
        finer = _between(values)
        known = np.zeros(finer.shape, bool)
        known[::2, ::2, ::2] = asked
        new = _corners(split) & ~known
        _ask(field, grid, step, new, finer)
        values, asked = finer, known | new
    return np.ascontiguousarray(values[tuple(slice(n) for n in grid.shape)])


def signed_distance(logits: Float32[np.ndarray, "x y z"], threshold: float) -> Float32[np.ndarray, "x y z"]:
    """Signed distance in voxels, positive outside, to where the occupancy is `threshold`; cut off at BAND.

    To first order: the log-odds above the threshold over their slope. Its sign is exact.
    """
    level = logits.astype(np.float64) - math.log(threshold / (1.0 - threshold))
    slope = np.sqrt(sum(np.clip(np.gradient(level, axis=axis), -_STEEPEST, _STEEPEST) ** 2 for axis in range(3)))
    return np.clip(-level / np.maximum(slope, 1e-6), -BAND, BAND).astype(np.float32)


def _ask(
    field: OccupancyField,
    grid: QueryGrid,
    step: int,
    where: Bool[np.ndarray, "x y z"],
    values: Float32[np.ndarray, "x y z"],
) -> None:
    """Write the field's answers at the chosen nodes, `step` voxels apart, into `values`."""
    index = np.argwhere(where)
    if len(index) == 0:
        return
    points = (grid.origin + grid.voxel * step * index).astype(np.float32)
    within = (np.abs(points) <= 1.0).all(axis=1)
    values[tuple(index[~within].T)] = _BEYOND
    index, points = index[within], points[within]
    answers = field.logits(torch.from_numpy(points)).detach().float().cpu().numpy()
    bad = ~np.isfinite(answers)
    if bad.any():
        raise CompleteError(
            f"The model answers {int(bad.sum())} of {len(bad)} queries with numbers that are not finite. "
            "Its weights are damaged or half trained: pass others."
        )
    values[tuple(index.T)] = answers


def _unsure(values: Float32[np.ndarray, "x y z"], band: float) -> Bool[np.ndarray, "i j k"]:
    """Cells between the nodes whose corners have both signs, or one below the band."""
    low = high = values
    least = np.abs(values)
    for axis in range(3):
        n = values.shape[axis]
        below, above = np.arange(n - 1), np.arange(1, n)
        low = np.minimum(low.take(below, axis), low.take(above, axis))
        high = np.maximum(high.take(below, axis), high.take(above, axis))
        least = np.minimum(least.take(below, axis), least.take(above, axis))
    return ((low < 0) & (high >= 0)) | (least < band)


def _holding(voxels: Bool[np.ndarray, "x y z"], step: int, cells: tuple[int, ...]) -> Bool[np.ndarray, "i j k"]:
    """Cells with any of the voxels in them or on their border."""
    held = voxels
    for axis, count in enumerate(cells):
        short = max(0, count * step + 1 - held.shape[axis])
        held = np.pad(held, [(0, short if a == axis else 0) for a in range(3)])
        parts = [held.take(range(o, o + step * (count - 1) + 1, step), axis) for o in range(step + 1)]
        held = np.logical_or.reduce(parts)
    return held


def _grown(cells: Bool[np.ndarray, "i j k"]) -> Bool[np.ndarray, "i j k"]:
    """The cells and all that touch them."""
    for axis in range(3):
        wide = np.pad(cells, [(1, 1) if a == axis else (0, 0) for a in range(3)])
        n = cells.shape[axis]
        cells = np.logical_or.reduce([wide.take(range(o, o + n), axis) for o in range(3)])
    return cells


def _corners(cells: Bool[np.ndarray, "i j k"]) -> Bool[np.ndarray, "x y z"]:
    """Nodes of the next finer level that lie in or on the cells."""
    nodes = cells
    for axis in range(3):
        n = nodes.shape[axis]
        finer = np.zeros([2 * n + 1 if a == axis else nodes.shape[a] for a in range(3)], bool)
        lines = np.moveaxis(finer, axis, 0)
        for offset in range(3):
            lines[offset : offset + 2 * n - 1 : 2] |= np.moveaxis(nodes, axis, 0)
        nodes = finer
    return nodes


def _between(values: Float32[np.ndarray, "x y z"]) -> Float32[np.ndarray, "i j k"]:
    """Values at twice the resolution, new ones halfway."""
    for axis in range(3):
        lines = np.moveaxis(values, axis, 0)
        finer = np.zeros((2 * len(lines) - 1, *lines.shape[1:]), np.float32)
        finer[::2] = lines
        finer[1::2] = 0.5 * (lines[:-1] + lines[1:])
        values = np.moveaxis(finer, 0, axis)
    return values
