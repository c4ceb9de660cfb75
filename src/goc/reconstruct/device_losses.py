"""The losses of paper §4.2–4.4 in plain PyTorch: for a batch of views on any device, any dtype, gradients by autograd.

What `losses` computes in native calls, and the twin of those in the tests. Nothing here waits for the device.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int16
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from goc.scene.capture import UNLABELLED

_RADIUS, _SIGMA_PX = 5, 1.5
_MIN_ALPHA, _MIN_DENOMINATOR = 0.1, 0.01
"""Below, nothing worth a depth was rendered, or planes are seen edge-on; native/lanes/geometry.cpp has the same."""
_C1, _C2 = 1e-4, 9e-4
"""Of SSIM, (0.01)² and (0.03)²."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Depths:
    """Rendered depths of a batch as fractions of blended channels, as `RenderedDepth` of one view."""

    numerator: Float[Tensor, "v h w"]
    denominator: Float[Tensor, "v h w"]
    alpha: Float[Tensor, "v h w"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Priors:
    """What the geometry of a batch is compared with, as `GeometryPrior` of one view."""

    depth: Float[Tensor, "v h w"]
    """NaN = none."""
    normals: Float[Tensor, "v h w 3"] | None
    """Unit, NaN = none."""


def blended_depths(
    geometry: Float[Tensor, "v g h w"], alpha: Float[Tensor, "v h w"], rays: tuple[Tensor, Tensor]
) -> Depths:
    """Depth of four blended plane channels, D / (N·K⁻¹p) negated on both sides, or of one blended centre depth."""
    if geometry.shape[1] == 1:
        return Depths(numerator=geometry[:, 0], denominator=alpha, alpha=alpha)
    slope = geometry[:, 0] * rays[0] + geometry[:, 1] * rays[1] + geometry[:, 2]
    return Depths(numerator=-geometry[:, 3], denominator=-slope, alpha=alpha)


def photometric(
    image: Float[Tensor, "v 3 h w"], target: Float[Tensor, "v 3 h w"], ssim_weight: float
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """L_c, (1 - λ)·|C - Ĉ| + λ·(1 - SSIM), and the mean squared error of the image clamped to [0, 1]; of all views."""
    x, y = image.flatten(0, 1), target.flatten(0, 1)
    blurred = _blurred(torch.stack([x, y, x * x, y * y, x * y]))
    mx, my = blurred[0], blurred[1]
    xx, yy, xy = blurred[2] - mx * mx, blurred[3] - my * my, blurred[4] - mx * my
    ssim = ((2 * mx * my + _C1) * (2 * xy + _C2)) / ((mx * mx + my * my + _C1) * (xx + yy + _C2))
    loss = (1 - ssim_weight) * (x - y).abs().mean() + ssim_weight * (1 - ssim.mean())
    return loss, (x.detach().clamp(0.0, 1.0) - y).square().mean()


def _blurred(images: Float[Tensor, "k p h w"]) -> Float[Tensor, "k p h w"]:
    """By an 11×11 Gaussian window of 1.5 px, zeros round the image (Wang et al. 2004)."""
    offsets = torch.arange(-_RADIUS, _RADIUS + 1, dtype=images.dtype, device=images.device)
    taps = torch.exp(-offsets.square() / (2 * _SIGMA_PX**2))
    taps = taps / taps.sum()
    rows = F.conv2d(images.flatten(0, 1)[:, None], taps.view(1, 1, 1, -1), padding=(0, _RADIUS))
    return F.conv2d(rows, taps.view(1, 1, -1, 1), padding=(_RADIUS, 0)).view(images.shape)


def geometry(
    depths: Depths, priors: Priors, rays: tuple[Tensor, Tensor], depth_weight: float, normal_weight: float
) -> Float[Tensor, ""]:
    """λ_d·L_d + λ_dn·L_dn, Eq. (3) and (4), means over the valid pixels of each view, and over the views."""
    shown = (depths.alpha > _MIN_ALPHA) & (depths.denominator > _MIN_DENOMINATOR)
    depth = torch.where(shown, depths.numerator, 0.0) / torch.where(shown, depths.denominator, 1.0)
    known = shown & torch.isfinite(priors.depth)
    off = (depth - torch.where(known, priors.depth, 0.0)).abs()
    loss = depth_weight * _mean_of_views(off, known)
    if priors.normals is None or not normal_weight:
        return loss
    normals, met = _normals(depth, shown, rays)
    prior = priors.normals[:, 1:-1, 1:-1]
    met = met & torch.isfinite(prior).all(-1)
    cosine = (normals * torch.where(met[..., None], prior, 0.0)).sum(-1)
    off = depths.alpha.detach()[:, 1:-1, 1:-1] * (1.0 - cosine)
    return loss + normal_weight * _mean_of_views(off, met)


def _mean_of_views(values: Float[Tensor, "v h w"], known: Bool[Tensor, "v h w"]) -> Float[Tensor, ""]:
    sums = torch.where(known, values, 0.0).sum((1, 2))
    return (sums / known.sum((1, 2)).clamp_min(1)).mean()


def _normals(
    depth: Float[Tensor, "v h w"], shown: Bool[Tensor, "v h w"], rays: tuple[Tensor, Tensor]
) -> tuple[Float[Tensor, "v i j 3"], Bool[Tensor, "v i j"]]:
    """N_d of all but the border by central differences, and where it and its four neighbours show something."""
    points = torch.stack([rays[0] * depth, rays[1] * depth, depth], -1)
    across = points[:, 1:-1, 2:] - points[:, 1:-1, :-2]
    along = points[:, 2:, 1:-1] - points[:, :-2, 1:-1]
    normals = torch.linalg.cross(along, across)
    squared = normals.square().sum(-1, keepdim=True)
    met = shown[:, 1:-1, 1:-1] & shown[:, 1:-1, 2:] & shown[:, 1:-1, :-2] & shown[:, 2:, 1:-1] & shown[:, :-2, 1:-1]
    met = met & (squared[..., 0] > 1e-24)
    return normals * torch.where(met[..., None], squared, 1.0).rsqrt(), met


def identity(logits: Float[Tensor, "p k"], classes: Int16[Tensor, "p"]) -> Float[Tensor, ""]:
    """L_o: cross-entropy, mean over labelled pixels; 0 where none is."""
    total = F.cross_entropy(logits, classes.long(), ignore_index=UNLABELLED, reduction="sum")
    return total / (classes != UNLABELLED).sum().clamp_min(1)
