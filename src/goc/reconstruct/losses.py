"""The losses of paper §4.2–4.4: means over valid pixels (docs/decisions/0006), each a scalar."""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc import _native
from goc.scene.camera import Camera
from goc.scene.capture import UNLABELLED

_photometric = _native.Photometric()
_geometry = _native.GeometryLoss()


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


@dataclass(frozen=True, kw_only=True, eq=False)
class GeometryPrior:
    """What a view's geometry is compared with."""

    depth: Float[Tensor, "h w"]
    """z, scene units; NaN = none."""
    normals: Float[Tensor, "h w 3"] | None
    """Unit, camera axes, facing the camera; NaN = none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedDepth:
    """A rendered depth as a fraction of blended channels, both differentiable."""

    numerator: Float[Tensor, "h w"]
    denominator: Float[Tensor, "h w"]
    """Positive where there is a depth."""
    alpha: Float[Tensor, "h w"]
    """Accumulated opacity."""


def expected_depth(blended: Float[Tensor, "h w"], alpha: Float[Tensor, "h w"]) -> RenderedDepth:
    """Depth of the splats' centres, Eq. (2): Σ z α T / alpha. On slanted surfaces it is biased towards the camera."""
    return RenderedDepth(numerator=blended, denominator=alpha, alpha=alpha)


def planes_depth(
    blended: Float[Tensor, "h w 4"], alpha: Float[Tensor, "h w"], rays: Float[Tensor, "h w 3"]
) -> RenderedDepth:
    """Depth of the splats' planes, D / (N·K⁻¹p), from blended `plane_channels`; negated so that both are positive."""
    return RenderedDepth(numerator=-blended[..., 3], denominator=-(blended[..., :3] * rays).sum(-1), alpha=alpha)


def geometry_loss(
    depth: RenderedDepth, prior: GeometryPrior, camera: Camera, depth_weight: float, normal_weight: float
) -> Float[Tensor, ""]:
    """λ_d·L_d + λ_dn·L_dn, Eq. (3) and (4), of a rendered depth D.

    L_d is the mean |D - D̂| over pixels with a prior. L_dn is the mean of alpha·(1 - N_d·N̂) over pixels with a prior,
    where N_d is the cross product of central differences of the back-projected D; alpha only weighs there, no gradient
    reaches it. Pixels with alpha ≤ 0.1 show nothing and do not count. Twin: tests/oracles/losses.py.

    Args:
        depth: D, by either definition.
        prior: depth and normals to compare with.
        camera: the view.
        depth_weight: λ_d, per scene unit.
        normal_weight: λ_dn.
    """
    return _Geometry.apply(
        depth.numerator, depth.denominator, depth.alpha, prior, camera, (depth_weight, normal_weight)
    )


class _Geometry(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        numerator: Tensor,
        denominator: Tensor,
        alpha: Tensor,
        prior: GeometryPrior,
        camera: Camera,
        weights: tuple[float, float],
    ) -> Tensor:
        gradients = torch.empty(2, *numerator.shape)
        images = (image.detach().contiguous() for image in (numerator, denominator, alpha, prior.depth))
        normals = None if prior.normals is None or not weights[1] else prior.normals.contiguous()
        lens = (*camera.focal_px.tolist(), *camera.centre_px.tolist())
        depth, depth_normal = _geometry(*images, normals, *lens, *weights, *gradients)
        ctx.save_for_backward(gradients)
        return torch.tensor(weights[0] * depth + weights[1] * depth_normal, dtype=torch.float32)

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        (gradients,) = ctx.saved_tensors
        return gradients[0] * upstream, gradients[1] * upstream, None, None, None, None


def identity_loss(logits: Float[Tensor, "p k"], classes: Int16[Tensor, "p"]) -> Float[Tensor, ""]:
    """L_o: cross-entropy between predicted and given instance, mean over labelled pixels; 0 where none is."""
    known = classes != UNLABELLED
    if not known.any():
        return logits.sum() * 0.0
    return torch.nn.functional.cross_entropy(logits[known], classes[known].long())
