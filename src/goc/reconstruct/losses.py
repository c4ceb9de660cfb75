"""The losses of paper §4.2–4.4: means over valid pixels (docs/decisions), each a scalar."""

from typing import Any

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc import _native
from goc.scene.capture import UNLABELLED

_photometric = _native.Photometric()


def photometric_loss(
    image: Float[Tensor, "h w 3"], target: Float[Tensor, "h w 3"], ssim_weight: float
) -> Float[Tensor, ""]:
    """L_c of 3D Gaussian Splatting: (1 - λ)·|C - Ĉ| + λ·(1 - SSIM), means over pixels and channels.

    SSIM with an 11×11 Gaussian window of 1.5 px and zero padding (Wang et al. 2004). Differentiable in `image`.
    """
    return _Photometric.apply(image, target, ssim_weight)


class _Photometric(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, ssim_weight: float) -> Tensor:
        planes, wanted = (array.detach().permute(2, 0, 1).contiguous() for array in (image, target))
        gradient = torch.empty_like(planes)
        loss = _photometric(planes, wanted, ssim_weight, gradient)
        ctx.save_for_backward(gradient)
        return torch.tensor(loss, dtype=torch.float32)

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, None, None]:
        (gradient,) = ctx.saved_tensors
        return (gradient * upstream).permute(1, 2, 0), None, None


def depth_loss(depth: Float[Tensor, "h w"], prior: Float[Tensor, "h w"]) -> Float[Tensor, ""]:
    """L_d, Eq. (3): mean |D - D̂| over pixels where the prior is known (finite), metres; 0 where none is."""
    known = torch.isfinite(prior)
    difference = torch.where(known, depth - torch.nan_to_num(prior), 0.0).abs()
    return difference.sum() / known.sum().clamp_min(1)


def depth_normal_loss(
    normals: Float[Tensor, "h w 3"], prior: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"]
) -> Float[Tensor, ""]:
    """Alpha-weighted disagreement of directions, Eq. (4): mean of alpha (1 - N_d · N_prior).

    Args:
        normals: N_d, unit, camera axes, derived from the rendered depth; NaN = none.
        prior: unit, camera axes; NaN = none.
        alpha: accumulated opacity in [0, 1].

    Returns:
        Scalar in [0, 2], 0 where both agree; pixels without one or the other do not count.
    """
    known = torch.isfinite(normals).all(-1) & torch.isfinite(prior).all(-1)
    # NaN is taken out before the product: its gradient would be NaN even where `known` masks it.
    cosine = (torch.nan_to_num(normals) * torch.nan_to_num(prior)).sum(-1)
    return torch.where(known, alpha * (1.0 - cosine), 0.0).sum() / known.sum().clamp_min(1)


def identity_loss(logits: Float[Tensor, "p k"], classes: Int16[Tensor, "p"]) -> Float[Tensor, ""]:
    """L_o: cross-entropy between predicted and given instance, mean over labelled pixels; 0 where none is."""
    known = classes != UNLABELLED
    if not known.any():
        return logits.sum() * 0.0
    return torch.nn.functional.cross_entropy(logits[known], classes[known].long())
