"""Monocular depth aligned before there are splats: with stereo and with the capture's points."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from goc.events import Listener, Progress, Warned
from goc.geometry.monocular import ROW, SCALE, fitted_row
from goc.scene.camera import Camera
from goc.scene.capture import Capture, Frame, PointCloud
from goc.scene.priors import CoarseDepth

_CELLS = 24
"""Points compete for cells of this share of a view's width: what lies behind the nearest in its cell is hidden."""
_BEHIND = 0.1


def align_views(
    capture: Capture, views: list[int], known: Mapping[int, CoarseDepth], notify: Listener
) -> Float[Tensor, "n r"]:
    """Align each view's depth with what is known of it: depths of other origin, and the capture's points.

    Args:
        capture: its depth is affine or inverse.
        views: which are to be aligned.
        known: depth from elsewhere, such as stereo, by view; may be empty or lack views.
        notify: hears Warned of the views that could not be aligned. They get no seeds, and no loss until a refresh.

    Returns:
        A row for each view of the capture, as `goc.geometry.monocular` lays it out; NaN for those not aligned.
    """
    rows = torch.full((len(capture), ROW), torch.nan)
    unaligned = []
    for done, view in enumerate(views, 1):
        frame = capture[view]
        if frame.depth is not None:
            rows[view] = fitted_row(*_compared(frame, capture.points, known.get(view)), capture.depth_kind)
            unaligned += [] if torch.isfinite(rows[view, SCALE]) else [capture.view_names[view]]
        notify(Progress(stage="align", done=done, total=len(views)))
    if unaligned:
        counted = f"{len(unaligned)} of {len(views)} views (first: {unaligned[0]})"
        notify(Warned(stage="priors", message=f"the depth of {counted} agrees with nothing known"))
    return rows


def _compared(
    frame: Frame, points: PointCloud | None, known: CoarseDepth | None
) -> tuple[Float[Tensor, "r c"], Float[Tensor, "r c"]]:
    """Stored depth, and all that is known, on the raster of what is known (where only points are, the view's own)."""
    assert frame.depth is not None
    known = known or CoarseDepth(camera=frame.camera, depth=torch.full_like(frame.depth, torch.nan))
    camera, depth = known.camera, known.depth
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
