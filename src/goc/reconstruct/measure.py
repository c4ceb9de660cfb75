"""How well splats show views that they did not learn from."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from goc.events import Listener, Progress
from goc.raster import render
from goc.scene.camera import Camera
from goc.scene.capture import Capture, Frame
from goc.scene.gaussians import Gaussians


@dataclass(frozen=True, kw_only=True)
class _Found:
    """Of one view."""

    psnr_db: float
    depth_error: float | None
    """Median, scene units."""


@torch.no_grad()
def measure(gaussians: Gaussians, capture: Capture, views: list[int], name: str, notify: Listener) -> dict[str, float]:
    """Mean PSNR (dB) and mean depth error (metres) over the views, whose figures start with `name`.

    Where alignment corrected the capture, PSNR is that of the corrected cameras, after a gain and an offset of each
    channel that make the render most like the given photograph; `name`_psnr_raw_db has the given cameras and no such
    fit. A camera and an exposure are no fault of the splats, but only the second figure is free of any fit.
    """
    if not views:
        return {}
    alignment, found, raw = capture.alignment, [], []
    corrected = alignment is not None and (alignment.moved or alignment.exposure is not None)
    for done, view in enumerate(views, 1):
        frame = capture[view]
        if alignment is None or not corrected:
            found.append(_of_view(gaussians, frame.camera, frame, False, capture.has_metric_depth))
        else:
            given = alignment.frames(view)
            found.append(_of_view(gaussians, frame.camera, given, True, capture.has_metric_depth))
            raw.append(_of_view(gaussians, alignment.cameras[view], given, False, False))
        notify(Progress(stage="measure", done=done, total=len(views)))
    told = {f"{name}_psnr_db": sum(one.psnr_db for one in found) / len(found), f"{name}_views": float(len(views))}
    if raw:
        told[f"{name}_psnr_raw_db"] = sum(one.psnr_db for one in raw) / len(raw)
    errors = [one.depth_error for one in found if one.depth_error is not None]
    if errors:
        told[f"{name}_median_depth_error_m"] = sum(errors) / len(errors) / capture.units_per_metre
    return told


def _of_view(gaussians: Gaussians, camera: Camera, frame: Frame, fitted: bool, with_depth: bool) -> _Found:
    shown, photo = render(gaussians, camera), frame.image.float() / 255.0
    colour = shown.colour.cpu()
    if fitted:
        colour = exposed_alike(colour, photo, frame.valid)
    squares = (colour - photo).square()
    error = (squares if frame.valid is None else squares[frame.valid]).mean().clamp_min(1e-10)
    apart = None
    if frame.depth is not None and with_depth:
        difference = (shown.plane_depth.cpu() - frame.depth).abs()
        apart = difference[torch.isfinite(difference)].median().item()
    return _Found(psnr_db=-10.0 * math.log10(error.item()), depth_error=apart)


def exposed_alike(
    shown: Float[Tensor, "h w 3"], photo: Float[Tensor, "h w 3"], valid: Bool[Tensor, "h w"] | None = None
) -> Float[Tensor, "h w 3"]:
    """A render with the gain and offset of each channel that make it most like a photograph, where that is valid."""
    x, y = (image.double().flatten(0, 1) if valid is None else image.double()[valid] for image in (shown, photo))
    across, middle = x - x.mean(0), y - y.mean(0)
    gain = (across * middle).sum(0) / across.square().sum(0).clamp_min(1e-12)
    return ((shown.double() - x.mean(0)) * gain + y.mean(0)).clamp(0.0, 1.0).float()
