"""The input of fusion: depth, obliqueness, ids and colours of one frame, with its pinhole camera."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int16, UInt8

from goc import _native
from goc.errors import ExtractError
from goc.events import Listener, Progress
from goc.geometry.native_camera import native_camera
from goc.scene import Camera, Capture, Frame

_FIT_RADIUS_PX = 2
_FIT_AGREE = 0.03
"""Neighbours within 3 % of a pixel's depth lie on its surface, for the plane fitted there."""
_FIT_FEWEST = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthView:
    """One frame, as the kernels take it."""

    depth: Float32[np.ndarray, "h w"]
    """z, scene units; NaN = none."""
    slope: Float32[np.ndarray, "h w"]
    """Cosine between ray and surface normal, (0, 1]; NaN at flying pixels, which are ignored."""
    ids: Int16[np.ndarray, "h w"] | None
    colours: UInt8[np.ndarray, "h w 3"] | None
    """sRGB; None where the surface needs no colours."""
    camera: Camera
    """Of the images' height and width, on the CPU."""


def depth_view(frame: Frame) -> DepthView | None:
    """Prepare a frame for fusion; None where it has no depth."""
    if frame.depth is None:
        return None
    depth = frame.depth.numpy().astype(np.float32)
    depth = np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(np.nan))
    slope = np.zeros_like(depth)
    _native.depth_slope(depth, native_camera(frame.camera), _FIT_RADIUS_PX, _FIT_AGREE, _FIT_FEWEST, slope)
    ids = None if frame.ids is None else np.ascontiguousarray(frame.ids.numpy())
    return DepthView(
        depth=depth,
        slope=slope,
        ids=ids,
        colours=np.ascontiguousarray(frame.image.numpy()),
        camera=frame.camera,
    )


def depth_views(views: Capture, stage: str, notify: Listener) -> Iterator[DepthView]:
    """All views that have depth, in order, reporting progress.

    Raises:
        ExtractError: no view has metric depth.
    """
    found = 0
    for index in range(len(views)) if views.has_metric_depth else []:
        view = depth_view(views[index])
        if view is not None:
            found += 1
            yield view
        notify(Progress(stage=stage, done=index + 1, total=len(views)))
    if not found:
        raise ExtractError(f"None of {len(views)} views has metric depth: no surface to fuse. Render depth first.")
