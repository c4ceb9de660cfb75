"""Monocular depth made comparable: scale and offset of each view, found before the start and again as splats improve.

What is known of a view is one row of `State.views["alignment"]`: k, b, the epoch in which they were last fitted, the
b / k that its fitted normals belong to (the shape of a surface depends on nothing else), and a grid of slow errors, by
which k·D + b is stretched. NaN = not aligned.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from goc.events import Listener, Progress, Warned
from goc.geometry.alignment import CELLS, align, aligned_depth, slow_errors, spread
from goc.reconstruct.config import Monocular
from goc.reconstruct.losses.depth import RenderedDepth
from goc.scene.camera import Camera
from goc.scene.capture import Capture, DepthKind, Frame, FrameSource, PointCloud

ALIGNMENT = "alignment"
SCALE, OFFSET, EPOCH, SHAPE = range(4)
GRID = slice(4, 4 + CELLS * CELLS)
ROW = GRID.stop
KnownDepths = Mapping[int, tuple[Camera, Float[Tensor, "_h _w"]]]
"""Depth of views that is known before there are splats: z, scene units, NaN = none, and the camera of its raster."""

_STEEPEST = math.tan(math.radians(80.0))
"""Surfaces slanted more than this are taken for the ramp that a blurred edge makes of two."""
_CELLS = 24
"""Points compete for cells of this share of a view's width: what lies behind the nearest in its cell is hidden."""
_BEHIND = 0.1
_MIN_ALPHA = 0.5
"""Pixels that show less splat than background say nothing of depth."""
_SAME_SHAPE = 0.02
"""Fitted normals are kept until the offset, in depths of the view, changed by this."""
_SAMPLES = 2048


def start_alignment(capture: Capture, views: list[int], known: KnownDepths, notify: Listener) -> Float[Tensor, "n r"]:
    """Align each view's depth with what is known of it: depths of other origin, and the capture's points.

    Args:
        capture: its depth is affine or inverse.
        views: which are to be aligned.
        known: depth from elsewhere, such as stereo; may be empty or lack views.
        notify: hears Warned of the views that could not be aligned. They get no seeds, and no loss until a refresh.
    """
    rows = torch.full((len(capture), ROW), torch.nan)
    unaligned = []
    for done, view in enumerate(views, 1):
        frame = capture[view]
        if frame.depth is not None:
            rows[view] = _row(*_compared(frame, capture.points, known.get(view)), capture.depth_kind)
            unaligned += [] if torch.isfinite(rows[view, SCALE]) else [capture.view_names[view]]
        notify(Progress(stage="align", done=done, total=len(views)))
    if unaligned:
        counted = f"{len(unaligned)} of {len(views)} views (first: {unaligned[0]})"
        notify(Warned(stage="reconstruct", message=f"the depth of {counted} agrees with nothing known"))
    return rows


def aligned_frame(frame: Frame, row: Float[Tensor, "r"], kind: DepthKind) -> Frame:
    """The frame with depth in scene units, without the ramps of blurred edges; without depth where not aligned."""
    if frame.depth is None or not torch.isfinite(row[SCALE]):
        return replace(frame, depth=None)
    depth = _bent(row, aligned_depth(frame.depth, row[:2], kind))
    return replace(frame, depth=torch.where(_ramps(depth, frame.camera), torch.nan, depth))


def _bent(row: Float[Tensor, "r"], depth: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    return depth * (1.0 + spread(row[GRID].view(CELLS, CELLS), *depth.shape))


def aligned_capture(capture: Capture, rows: Float[Tensor, "n r"]) -> Capture:
    """The capture with its depth aligned: what a depth camera would have seen, as far as is known."""
    some = bool(torch.isfinite(rows[:, SCALE]).any())
    frames = AlignedFrames(below=capture.frames, rows=rows, kind=capture.depth_kind)
    return replace(capture, frames=frames, has_depth=some, depth_kind="metric")


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedFrames:
    """The views of another source, with their depth aligned."""

    below: FrameSource
    rows: Float[Tensor, "n r"]
    kind: DepthKind

    def __call__(self, index: int) -> Frame:
        """One view; without depth where it is not aligned."""
        return aligned_frame(self.below(index), self.rows[index], self.kind)


def shape_of(frame: Frame, row: Float[Tensor, "r"], kind: DepthKind) -> Float[Tensor, "h w"]:
    """Depth up to scale, as the row's fitted normals see it."""
    assert frame.depth is not None
    return aligned_depth(frame.depth, torch.stack([torch.tensor(1.0), row[SHAPE]]), kind)


@torch.no_grad()
def refresh(
    row: Float[Tensor, "r"], frame: Frame, kind: DepthKind, shown: RenderedDepth, epoch: int, config: Monocular
) -> None:
    """Fit k, b again, in place, to the depth that the splats show, if it is time to.

    Where the fit has no answer the old one stays; a view that has none waits for the next epoch.
    """
    fresh = not torch.isfinite(row[SCALE])
    due = fresh or (config.refresh_every > 0 and epoch >= row[EPOCH] + config.refresh_every)
    if frame.depth is None or not due:
        return
    step = max(1, math.isqrt(frame.depth.numel() // _SAMPLES))
    at = (slice(step // 2, None, step),) * 2
    alpha, numerator, denominator = (image[0][at] for image in (shown.alpha, shown.numerator, shown.denominator))
    seen = (alpha > _MIN_ALPHA) & (denominator > 1e-6)
    depth = torch.where(seen, numerator / denominator, torch.nan)
    stored = frame.depth[at]
    field = spread(row[GRID].view(CELLS, CELLS), *stored.shape)
    line = align(stored.reshape(-1), (depth if fresh else depth / (1.0 + field)).reshape(-1), kind)
    if line is None:
        return
    kept = 0.0 if fresh else config.smoothing
    row[:2] = line if fresh else kept * row[:2] + (1.0 - kept) * line
    if fresh:
        row[GRID] = slow_errors(depth, aligned_depth(stored, line, kind)).reshape(-1)
    row[EPOCH] = float(epoch)
    shape = row[OFFSET] / row[SCALE]
    size = frame.depth[at].nanmedian() + shape
    if fresh or not abs(shape - row[SHAPE]) <= _SAME_SHAPE * size:
        row[SHAPE] = shape


def _row(stored: Float[Tensor, "h w"], known: Float[Tensor, "h w"], kind: DepthKind) -> Float[Tensor, "r"]:
    line = align(stored.reshape(-1), known.reshape(-1), kind)
    if line is None:
        return torch.full((ROW,), torch.nan)
    field = slow_errors(known, aligned_depth(stored, line, kind))
    return torch.cat([line, torch.stack([torch.tensor(0.0), line[1] / line[0]]), field.reshape(-1)])


def _compared(
    frame: Frame, points: PointCloud | None, known: tuple[Camera, Float[Tensor, "r c"]] | None
) -> tuple[Float[Tensor, "r c"], Float[Tensor, "r c"]]:
    """Stored depth, and all that is known, on the raster of what is known (where only points are, the view's own)."""
    assert frame.depth is not None
    camera, depth = known or (frame.camera, torch.full_like(frame.depth, torch.nan))
    rows = ((torch.arange(camera.height) + 0.5) * frame.camera.height / camera.height).long()
    columns = ((torch.arange(camera.width) + 0.5) * frame.camera.width / camera.width).long()
    if points is not None:
        seen = _points_raster(camera, torch.from_numpy(points.positions))
        depth = torch.where(torch.isfinite(seen), seen, depth)
    return frame.depth[rows][:, columns], depth


def _points_raster(camera: Camera, points: Float[Tensor, "p 3"]) -> Float[Tensor, "h w"]:
    """Depth of the points in view, NaN elsewhere; of points that share a cell, only the near ones."""
    px, z = camera.project(points)
    inside = (z > 1e-6) & (px >= 0).all(-1) & (px < torch.tensor([camera.width, camera.height])).all(-1)
    z, px = z[inside], px[inside].long()
    cell = px * _CELLS // camera.width
    key = cell[:, 1] * _CELLS + cell[:, 0]
    rows = -(-camera.height * _CELLS // camera.width)
    nearest = torch.full((rows * _CELLS,), torch.inf).scatter_reduce(0, key, z, "amin")
    near = z <= nearest[key] * (1.0 + _BEHIND)
    raster = torch.full((camera.height * camera.width,), torch.inf)
    raster = raster.scatter_reduce(0, (px[:, 1] * camera.width + px[:, 0])[near], z[near], "amin")
    return torch.where(torch.isfinite(raster), raster, torch.nan).view(camera.height, camera.width)


def _ramps(depth: Float[Tensor, "h w"], camera: Camera) -> Bool[Tensor, "h w"]:
    """Whether depth changes too fast round a pixel, seen through a 3 x 3 mean that takes out noise."""
    pool = torch.nn.functional
    known = torch.isfinite(depth)
    filled = torch.where(known, depth, 0.0)[None, None]
    share = pool.avg_pool2d(known[None, None].float(), 3, 1, 1)
    smooth = pool.avg_pool2d(filled, 3, 1, 1) / share.clamp_min(1e-6)
    highest, lowest = pool.max_pool2d(smooth, 3, 1, 1), -pool.max_pool2d(-smooth, 3, 1, 1)
    return ((highest - lowest) > 2.0 * _STEEPEST / camera.focal_px[0] * smooth)[0, 0]
