"""The scene as its splats show it: a capture whose depth and ids are rendered."""

from dataclasses import replace

import torch
from torch import Tensor

from goc.raster import CPU, render_surface
from goc.scene.capture import UNLABELLED, Capture, Frame
from goc.scene.reconstruction import Reconstruction

_KEPT_BYTES = 512 * 2**20
"""Rendered depth and ids kept for the next pass: of the first views, since passes go through all views in order and
would empty a cache that drops the oldest before they come back to it."""
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
    gaussians, labels = reconstruction.gaussians.to(device), reconstruction.labels.to(device)
    labelled = bool((labels != UNLABELLED).any())
    kept: dict[int, tuple[Tensor, Tensor | None]] = {}

    def rendered(index: int) -> tuple[Tensor, Tensor | None]:
        shown = render_surface(gaussians, labels if labelled else None, capture.cameras[index], _MIN_ALPHA)
        depth = torch.where(shown.mixed > _MAX_SPREAD, shown.median_depth, shown.plane_depth)
        depth = torch.where(shown.alpha >= _MIN_ALPHA, depth, torch.nan)
        return depth.cpu(), None if shown.ids is None else shown.ids.cpu()

    def load(index: int) -> Frame:
        depth, ids = kept[index] if index in kept else rendered(index)
        if (len(kept) + 1) * depth.numel() * 6 <= _KEPT_BYTES:  # float32 depth and 16-bit ids
            kept[index] = (depth, ids)
        return replace(capture[index], depth=depth, normals=None, ids=ids)

    return replace(capture, load=load, has_depth=True, has_ids=labelled, depth_kind="metric")
