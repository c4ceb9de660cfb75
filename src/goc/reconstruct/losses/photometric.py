"""L_c: rendered colour against photographs."""

from typing import Any

import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from goc import _native
from goc.reconstruct import kernels

_RADIUS, _SIGMA_PX = 5, 1.5
_C1, _C2 = 1e-4, 9e-4
"""Stabilising constants of SSIM, (0.01)² and (0.03)²."""
_kernel = _native.Photometric()


def photometric_loss(
    image: Float[Tensor, "v 3 h w"], target: UInt8[Tensor, "v h w 3"], ssim_weight: float
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """L_c of 3D Gaussian Splatting: (1 - λ)·|C - Ĉ| + λ·(1 - SSIM), means over views, pixels and channels.

    SSIM with an 11×11 Gaussian window of 1.5 px and zero padding (Wang et al. 2004). Differentiable in `image`.

    Args:
        image: blended colour, channel by channel.
        target: the photographs as stored; 255 is 1.
        ssim_weight: λ.

    Returns:
        L_c, and the mean squared error of the image clamped to [0, 1] (for PSNR).
    """
    if kernels.natively(image):
        return _Photometric.apply(image, target, ssim_weight)
    return photometric(image, target.permute(0, 3, 1, 2).to(image.dtype) / 255.0, ssim_weight)


def photometric(
    image: Float[Tensor, "v 3 h w"], target: Float[Tensor, "v 3 h w"], ssim_weight: float
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """Compute L_c and the mean squared error in PyTorch, as `photometric_loss`; `target` is from 0 to 1."""
    x, y = image.flatten(0, 1), target.flatten(0, 1)
    blurred = _blurred(torch.stack([x, y, x * x, y * y, x * y]))
    mx, my = blurred[0], blurred[1]
    xx, yy, xy = blurred[2] - mx * mx, blurred[3] - my * my, blurred[4] - mx * my
    ssim = ((2 * mx * my + _C1) * (2 * xy + _C2)) / ((mx * mx + my * my + _C1) * (xx + yy + _C2))
    loss = (1 - ssim_weight) * (x - y).abs().mean() + ssim_weight * (1 - ssim.mean())
    return loss, (x.detach().clamp(0.0, 1.0) - y).square().mean()


def _blurred(images: Float[Tensor, "k p h w"]) -> Float[Tensor, "k p h w"]:
    """Blur images with the Gaussian window, first along rows, then along columns."""
    offsets = torch.arange(-_RADIUS, _RADIUS + 1, dtype=images.dtype, device=images.device)
    taps = torch.exp(-offsets.square() / (2 * _SIGMA_PX**2))
    taps = taps / taps.sum()
    rows = F.conv2d(images.flatten(0, 1)[:, None], taps.view(1, 1, 1, -1), padding=(0, _RADIUS))
    return F.conv2d(rows, taps.view(1, 1, -1, 1), padding=(_RADIUS, 0)).view(images.shape)


class _Photometric(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, ssim_weight: float) -> tuple[Tensor, Tensor]:
        gradient, count = torch.empty(image.shape), len(image)
        views = zip(image.detach().contiguous(), target.contiguous(), gradient, strict=True)
        found = torch.tensor([_kernel(x, y, ssim_weight, out) for x, y, out in views], dtype=torch.float64)
        loss, square_error = found.mean(0).float().unbind()
        ctx.save_for_backward(gradient if count == 1 else gradient / count)
        ctx.mark_non_differentiable(square_error)
        ctx.set_materialize_grads(False)
        return loss, square_error

    @staticmethod
    def backward(ctx: Any, upstream: Tensor, _: None) -> tuple[Tensor | None, ...]:
        return kernels.scaled(ctx.saved_tensors[0], upstream), None, None
