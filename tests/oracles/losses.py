"""The losses by their definitions, any dtype, gradients by autograd."""

import torch
from torch import Tensor

from goc.geometry.normals import normals_from_depth
from goc.scene import Camera


def photometric(image: Tensor, target: Tensor, ssim_weight: float) -> Tensor:
    """(1 - λ)·L1 + λ·(1 - SSIM) of (h w 3) images, by dense 11×11 convolutions."""
    offsets = torch.arange(-5, 6, dtype=image.dtype)
    taps = torch.exp(-(offsets**2) / (2 * 1.5**2))
    window = torch.outer(taps, taps)[None, None] / taps.sum() ** 2
    x, y = image.permute(2, 0, 1)[:, None], target.permute(2, 0, 1)[:, None]

    def blur(values: Tensor) -> Tensor:
        return torch.nn.functional.conv2d(values, window, padding=5)

    mx, my = blur(x), blur(y)
    xx, yy, xy = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
    ssim = ((2 * mx * my + 1e-4) * (2 * xy + 9e-4)) / ((mx * mx + my * my + 1e-4) * (xx + yy + 9e-4))
    return (1 - ssim_weight) * (x - y).abs().mean() + ssim_weight * (1 - ssim.mean())


def depth_loss(depth: Tensor, prior: Tensor) -> Tensor:
    """Mean |D - D̂| over pixels where both are known."""
    known = torch.isfinite(prior) & torch.isfinite(depth)
    return (depth[known] - prior[known]).abs().sum() / known.sum().clamp_min(1)


def depth_normal_loss(depth: Tensor, prior: Tensor, alpha: Tensor, camera: Camera) -> Tensor:
    """Mean of alpha·(1 - N_d·N̂) over pixels where both normals are known."""
    normals = normals_from_depth(depth, camera)
    known = torch.isfinite(normals).all(-1) & torch.isfinite(prior).all(-1)
    terms = alpha[known] * (1.0 - (normals[known] * prior[known]).sum(-1))
    return terms.sum() / known.sum().clamp_min(1)
