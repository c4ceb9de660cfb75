"""Corrects slow errors of monocular depth: depth is changed until neighbouring photographs agree.

Stereo decides pixel by pixel. Here each cell of a view's grid gets one correction and keeps the shape that the network
predicted, so the faint shading of a white wall adds up over the cell, and no window lies across a depth edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from goc.events import Listener, Progress
from goc.geometry.alignment import CELLS, cell_means
from goc.geometry.monocular import GRID, SCALE, aligned_frame
from goc.geometry.neighbours import PairLimits, neighbour_views
from goc.scene.camera import Camera
from goc.scene.capture import Capture, Frame

_SIDE_PX = 192
"""Views are compared at this longest side, pixels."""
_STEPS = (0.02, 0.015, 0.01, 0.01)
"""Relative change of depth for the finite differences of each round: about one pixel of parallax."""
_SLACK = 0.5
"""Share of the squared slopes that divides each step: with all of them it takes ten rounds (measured)."""
_LARGEST = 0.03
"""Largest relative change of a cell's depth in one round."""
_RIDGE = 5.0
"""Squared slope (contrast per relative depth) at which photographs and initial depth weigh the same: (0.3 / 0.02)²
over some 40 independent pixels a cell, for contrast that differs by 0.3 and initial depth that is off by 2 %."""
_NEIGHBOURS = 8
_MAX_ANGLE_DEG, _BASELINES_M, _DEPTHS_M = 45.0, (0.15, 1.5), (1.0, 2.0, 4.0)
_WINDOW_PX = 7
_FLOOR = 1.5
"""Grey levels, added to the deviation that contrast is divided by, so that noise is not amplified."""
_DIFFERENT = 0.5
"""Difference in normalised grey levels from which on a pixel counts for little."""
_ONE_SURFACE = 0.1
"""Depths whose relative difference is smaller show one surface."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _View:
    """A view reduced to at most 192 pixels a side."""

    frame: Frame
    """Its depth is as stored, without alignment."""
    grey: Float[Tensor, "h w"]
    """Local contrast: mean 0 and deviation about 1 in each window."""


def bend(capture: Capture, views: list[int], rows: Float[Tensor, "n r"], notify: Listener) -> Float[Tensor, "n r"]:
    """Change the slow errors of aligned views by Gauss-Newton steps until neighbouring photographs agree.

    Args:
        capture: its depth is affine or inverse.
        views: indices of the views to use; those without an alignment are skipped.
        rows: alignments, as `align_views` makes them.
        notify: hears Progress.

    Returns:
        A copy of the rows with new slow errors; scales and offsets are unchanged.
    """
    rows = rows.clone()
    seen = {view: _view(capture[view]) for view in views if torch.isfinite(rows[view, SCALE])}
    if not seen:
        return rows
    near, far = (length * capture.units_per_metre for length in _BASELINES_M)
    depths_m = tuple(depth * capture.units_per_metre for depth in _DEPTHS_M)
    limits = PairLimits(max_angle_deg=_MAX_ANGLE_DEG, min_baseline=near, max_baseline=far, depths=depths_m)
    around = neighbour_views(capture.cameras, list(seen), _NEIGHBOURS, limits)
    start = rows[:, GRID].clone()
    for number, step in enumerate(_STEPS):
        kind = capture.depth_kind
        frames = {view: aligned_frame(item.frame, rows[view], kind) for view, item in seen.items()}
        for done, view in enumerate(seen, 1):
            others = [(seen[other], frames[other]) for other in around[view]]
            pull, hold = _evidence(seen[view], frames[view], others, step)
            moved = (rows[view, GRID] - start[view]).view(CELLS, CELLS)
            field = ((pull - _RIDGE * moved) / (_SLACK * hold + _RIDGE)).clamp(-_LARGEST, _LARGEST).reshape(-1)
            rows[view, GRID] = (1.0 + rows[view, GRID]) * (1.0 + field) - 1.0
            notify(Progress(stage="align", done=number * len(seen) + done, total=len(_STEPS) * len(seen)))
    return rows


def _view(frame: Frame) -> _View:
    camera = frame.camera
    scale = min(1.0, _SIDE_PX / max(camera.width, camera.height))
    camera = camera.resized(max(1, round(camera.width * scale)), max(1, round(camera.height * scale)))
    size = (camera.height, camera.width)
    image = F.interpolate(frame.image.permute(2, 0, 1)[None].float(), size, mode="area")
    assert frame.depth is not None
    depth = F.interpolate(frame.depth[None, None], size, mode="nearest-exact")[0, 0]
    colours = image[0].permute(1, 2, 0).round().to(torch.uint8)
    return _View(frame=Frame(camera=camera, image=colours, depth=depth), grey=_normalised(image.mean(1)[0]))


def _normalised(grey: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    side = _WINDOW_PX // 2
    padded = F.pad(grey[None, None], (side,) * 4, mode="replicate")
    mean = F.avg_pool2d(padded, _WINDOW_PX, 1)
    deviation = (F.avg_pool2d(padded.square(), _WINDOW_PX, 1) - mean.square()).clamp_min(0.0).sqrt()
    return ((grey - mean) / (deviation + _FLOOR))[0, 0]


def _evidence(
    view: _View, shown: Frame, others: Sequence[tuple[_View, Frame]], step: float
) -> tuple[Float[Tensor, "12 12"], Float[Tensor, "12 12"]]:
    """Means of -slope · error and slope² in each cell; their ratio is the relative change that its depth needs."""
    assert shown.depth is not None
    pull, hold = torch.zeros_like(shown.depth), torch.zeros_like(shown.depth)
    for other, surface in others:
        assert surface.depth is not None
        here, z = _projected(shown.depth, shown.camera, surface.camera)
        seen = F.grid_sample(surface.depth.nan_to_num(0.0)[None, None], here, mode="nearest", align_corners=False)
        visible = ((seen[0, 0] / z - 1.0).abs() < _ONE_SURFACE) & (here[0].abs() < 1.0).all(-1)
        beyond, before = (_projected(shown.depth * s, shown.camera, surface.camera)[0] for s in (1 + step, 1 - step))
        error = _sampled(other.grey, here) - view.grey
        slope = (_sampled(other.grey, beyond) - _sampled(other.grey, before)) / (2.0 * step)
        trust = visible / (1.0 + (error / _DIFFERENT).square()).square()
        pull -= trust * slope * error
        hold += trust * slope.square()
    return cell_means(pull), cell_means(hold)


def _projected(
    depth: Float[Tensor, "h w"], camera: Camera, other: Camera
) -> tuple[Float[Tensor, "1 h w 2"], Float[Tensor, "h w"]]:
    """Where each pixel's point projects in another camera: -1 to 1 across its image (9 if nowhere), and its z there."""
    px, z = other.project(camera.unproject_depth(depth))
    inside = px / torch.tensor([other.width, other.height]) * 2.0 - 1.0
    met = torch.isfinite(inside).all(-1)
    return torch.where(met[..., None], inside, 9.0).clamp(-9.0, 9.0)[None], z


def _sampled(image: Float[Tensor, "r c"], at: Float[Tensor, "1 h w 2"]) -> Float[Tensor, "h w"]:
    return F.grid_sample(image[None, None], at, align_corners=False, padding_mode="border")[0, 0]
