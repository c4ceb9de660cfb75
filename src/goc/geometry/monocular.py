"""Monocular depth of one view in scene units: scale, offset and slow errors, kept as one row of numbers.

A row holds k and b (SCALE, OFFSET); the epoch in which they were last fitted (EPOCH); the b / k that the view's fitted
normals belong to, since the shape of a surface depends on nothing else (SHAPE); and a grid of slow errors, by which
k·D + b is stretched (GRID). NaN = not aligned.
"""

import math
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from goc.geometry.alignment import CELLS, align, aligned_depth, slow_errors, spread
from goc.scene.camera import Camera
from goc.scene.capture import DepthKind, Frame

SCALE, OFFSET, EPOCH, SHAPE = range(4)
GRID = slice(4, 4 + CELLS * CELLS)
ROW = 4 + CELLS * CELLS
"""Numbers in a row."""

_STEEPEST = math.tan(math.radians(80.0))
"""Surfaces slanted more than this are taken for the ramp that a blurred edge makes of two."""


def fitted_row(stored: Float[Tensor, "h w"], known: Float[Tensor, "h w"], kind: DepthKind) -> Float[Tensor, "r"]:
    """The row of a view whose stored depth is compared with known depth (z, NaN = none); NaN where they disagree."""
    line = align(stored.reshape(-1), known.reshape(-1), kind)
    if line is None:
        return torch.full((ROW,), torch.nan)
    field = slow_errors(known, aligned_depth(stored, line, kind))
    return torch.cat([line, torch.stack([torch.tensor(0.0), line[1] / line[0]]), field.reshape(-1)])


def slow_error_grid(row: Float[Tensor, "r"]) -> Float[Tensor, "12 12"]:
    """The slow errors of a row, as shares of the depth."""
    return row[GRID].view(CELLS, CELLS)


def aligned_frame(frame: Frame, row: Float[Tensor, "r"], kind: DepthKind) -> Frame:
    """The frame with depth in scene units, without the ramps of blurred edges; without depth where not aligned."""
    if frame.depth is None or not torch.isfinite(row[SCALE]):
        return replace(frame, depth=None)
    depth = aligned_depth(frame.depth, row[:2], kind)
    depth = depth * (1.0 + spread(slow_error_grid(row), *depth.shape))
    return replace(frame, depth=torch.where(_ramps(depth, frame.camera), torch.nan, depth))


def shape_of(frame: Frame, row: Float[Tensor, "r"], kind: DepthKind) -> Float[Tensor, "h w"]:
    """Depth up to scale, as the row's fitted normals see it."""
    assert frame.depth is not None
    return aligned_depth(frame.depth, torch.stack([torch.tensor(1.0), row[SHAPE]]), kind)


def _ramps(depth: Float[Tensor, "h w"], camera: Camera) -> Bool[Tensor, "h w"]:
    """Whether depth changes too fast round a pixel, seen through a 3 x 3 mean that takes out noise."""
    pool = torch.nn.functional
    known = torch.isfinite(depth)
    filled = torch.where(known, depth, 0.0)[None, None]
    share = pool.avg_pool2d(known[None, None].float(), 3, 1, 1)
    smooth = pool.avg_pool2d(filled, 3, 1, 1) / share.clamp_min(1e-6)
    highest, lowest = pool.max_pool2d(smooth, 3, 1, 1), -pool.max_pool2d(-smooth, 3, 1, 1)
    return ((highest - lowest) > 2.0 * _STEEPEST / camera.focal_px[0] * smooth)[0, 0]
