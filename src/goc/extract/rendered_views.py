"""The scene as its splats show it: a capture whose depth and ids are rendered."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc.device import CPU
from goc.raster import render_surface
from goc.scene.cache import ViewCache
from goc.scene.camera import Camera
from goc.scene.capture import UNLABELLED, Capture, Frame, FrameSource
from goc.scene.gaussians import Gaussians
from goc.scene.reconstruction import Reconstruction

_KEPT_BYTES = 512 * 2**20
"""Rendered depth and ids kept, all views together."""
_MIN_ALPHA = 0.5
"""A pixel that is more background than splat has no depth."""
_MAX_SPREAD = 0.02
"""A pixel whose splats' depths spread by more than this share of its depth mixes what is near with what lies behind.
Its blended depth would put flying surface between; it gets the depth of the one splat that makes it half opaque."""


def rendered_views(reconstruction: Reconstruction, capture: Capture, device: torch.device = CPU) -> Capture:
    """The capture with its depth and ids replaced by those of the splats, rendered on demand.

    Depth is that of the splats' planes, not of their centres: it has no bias on slanted splats. Images stay the
    photographs. What was rendered is kept, within bounds, since extraction looks at each view several times. Splats are
    drawn on `device`; the views are on the processor.
    """
    labels = reconstruction.labels
    labelled = bool((labels != UNLABELLED).any())
    drawn = SplatImages(
        gaussians=reconstruction.gaussians.to(device), labels=labels if labelled else None, cameras=capture.cameras
    )
    frames = RenderedFrames(below=capture.frames, drawn=ViewCache(drawn, _KEPT_BYTES))
    return replace(capture, frames=frames, has_depth=True, has_ids=labelled, depth_kind="metric")


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthAndIds:
    """Depth and ids of one view, on the processor."""

    depth: Float[Tensor, "h w"]
    """z, scene units; NaN where there is none."""
    ids: Int16[Tensor, "h w"] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class SplatImages:
    """Draws depth and ids of views, on the device where the splats are."""

    gaussians: Gaussians
    labels: Int16[Tensor, "n"] | None
    cameras: tuple[Camera, ...]

    def __call__(self, index: int) -> DepthAndIds:
        """One view's."""
        labels = None if self.labels is None else self.labels.to(self.gaussians.means.device)
        shown = render_surface(self.gaussians, labels, self.cameras[index], _MIN_ALPHA)
        depth = torch.where(shown.mixed > _MAX_SPREAD, shown.median_depth, shown.plane_depth)
        depth = torch.where(shown.alpha >= _MIN_ALPHA, depth, torch.nan)
        return DepthAndIds(depth=depth.cpu(), ids=None if shown.ids is None else shown.ids.cpu())


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedFrames:
    """The photographs of another source, with depth and ids drawn or chosen."""

    below: FrameSource
    drawn: ViewCache[DepthAndIds]

    def __call__(self, index: int) -> Frame:
        """One view."""
        drawn, frame = self.drawn(index), self.below(index)
        depth, ids = drawn.depth, drawn.ids
        if frame.valid is not None:  # nobody saw it: splats may be anything there
            depth = torch.where(frame.valid, depth, torch.nan)
            ids = None if ids is None else ids.masked_fill(~frame.valid, UNLABELLED)
        return replace(frame, depth=depth, normals=None, ids=ids)
