"""Smooth completion of images with holes."""

import torch
from jaxtyping import Float
from torch import Tensor


def filled(image: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    """The image with NaN replaced by smooth values from around: pull-push (Gortler et al. 1996).

    Holes take the mean of their surroundings at the finest of ever coarser copies that knows any. An image without
    any value stays as it is.
    """
    known = torch.isfinite(image)
    if known.all() or not known.any():
        return image
    weight = known.float()[None, None]
    value = torch.where(known, image, 0.0)[None, None]
    coarse_weight = torch.nn.functional.avg_pool2d(weight, 2, ceil_mode=True, count_include_pad=False)
    coarse = torch.nn.functional.avg_pool2d(value, 2, ceil_mode=True, count_include_pad=False) / coarse_weight
    size = (image.shape[0], image.shape[1])
    below = filled(torch.where(coarse_weight > 0, coarse, torch.nan)[0, 0])
    raised = torch.nn.functional.interpolate(below[None, None], size, mode="bilinear")[0, 0]
    return torch.where(known, image, raised)
