"""Monocular depth while splats improve: the capture as it is aligned, and fits of a view to what the splats show.

What is known of a view is its row of `State.views["alignment"]`, as `goc.geometry.monocular` lays it out. It starts as
the capture's priors have it and is refreshed in place.
"""

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from goc.geometry.alignment import align, aligned_depth, slow_errors, spread
from goc.geometry.monocular import EPOCH, GRID, OFFSET, ROW, SCALE, SHAPE, aligned_frame, slow_error_grid
from goc.reconstruct.config import Monocular
from goc.reconstruct.losses.depth import RenderedDepth
from goc.scene.capture import Capture, DepthKind, Frame, FrameSource

ALIGNMENT = "alignment"
_MIN_ALPHA = 0.5
"""Pixels that show less splat than background say nothing of depth."""
_SAME_SHAPE = 0.02
"""Fitted normals are kept until the offset, in depths of the view, changed by this."""
_SAMPLES = 2048


def alignment_of(capture: Capture) -> Float[Tensor, "n r"]:
    """A row for each view, to be refreshed in place: as the capture's priors have it; NaN where there are none."""
    if capture.priors is None or capture.priors.alignment is None:
        return torch.full((len(capture), ROW), torch.nan)
    return capture.priors.alignment.clone()


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
    field = spread(slow_error_grid(row), *stored.shape)
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
