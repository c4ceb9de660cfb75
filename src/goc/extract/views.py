"""The scene as its splats show it: a capture whose depth and ids are rendered."""

from collections import OrderedDict
from dataclasses import replace

import torch

from goc.raster import median_depth, render, render_labels
from goc.scene.capture import UNLABELLED, Capture, Frame
from goc.scene.reconstruction import Reconstruction

_CACHE_BYTES = 256 * 2**20
_MIN_ALPHA = 0.5
"""A pixel that is more background than splat has no depth."""
_MAX_SPREAD = 0.02
"""A pixel whose splats' depths spread by more than this share of its depth mixes what is near with what lies behind.
Its blended depth would put flying surface between; it gets the depth of the one splat that makes it half opaque."""


def rendered_views(reconstruction: Reconstruction, capture: Capture) -> Capture:
    """The capture with its depth and ids replaced by those of the splats, rendered on demand.

    Depth is that of the splats' planes, not of their centres: it has no bias on slanted splats. Images stay the
    photographs. Frames are kept in a bounded cache, since scene and objects are fused in two passes.
    """
    gaussians, labels = reconstruction.gaussians, reconstruction.labels
    labelled = bool((labels != UNLABELLED).any())
    cache: OrderedDict[int, Frame] = OrderedDict()

    def rendered(index: int) -> Frame:
        frame = capture[index]
        shown = render(gaussians, frame.camera)
        mixed = shown.depth_spread > _MAX_SPREAD * shown.depth
        depth = torch.where(mixed, median_depth(gaussians, frame.camera), shown.plane_depth)
        depth = torch.where(shown.alpha >= _MIN_ALPHA, depth, torch.nan)
        ids = render_labels(gaussians, labels, frame.camera, _MIN_ALPHA) if labelled else None
        return replace(frame, depth=depth, normals=None, ids=ids)

    def load(index: int) -> Frame:
        if index in cache:
            cache.move_to_end(index)
            return cache[index]
        frame = rendered(index)
        cache[index] = frame
        if len(cache) * frame.image.numel() * 3 > _CACHE_BYTES:  # depth, ids and colours: about 9 bytes a pixel
            cache.popitem(last=False)
        return frame

    return replace(capture, load=load, has_depth=True, has_ids=labelled)
