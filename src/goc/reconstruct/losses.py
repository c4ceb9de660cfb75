"""The losses of paper §4.2–4.4: means over valid pixels (docs/decisions/0026), each a scalar."""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int8, Int16, UInt8
from torch import Tensor

from goc import _native
from goc.scene.camera import Camera
from goc.scene.capture import UNLABELLED

_photometric = _native.Photometric()
_geometry = _native.GeometryLoss()


def photometric_loss(
    image: Float[Tensor, "3 h w"], target: UInt8[Tensor, "h w 3"], ssim_weight: float
) -> tuple[Float[Tensor, ""], float]:
    """L_c of 3D Gaussian Splatting: (1 - λ)·|C - Ĉ| + λ·(1 - SSIM), means over pixels and channels.

    SSIM with an 11×11 Gaussian window of 1.5 px and zero padding (Wang et al. 2004). Differentiable in `image`.

    Args:
        image: blended colour, channel by channel.
        target: the photograph as stored; 255 is 1.
        ssim_weight: λ.

    Returns:
        L_c, and the mean squared error of the image clamped to [0, 1] (for PSNR).
    """
    found: list[float] = []
    loss = _Photometric.apply(image, target, ssim_weight, found)
    return loss, found[0]


class _Photometric(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, ssim_weight: float, found: list[float]) -> Tensor:
        gradient = torch.empty(image.shape)
        loss, square_error = _photometric(image.detach().contiguous(), target.contiguous(), ssim_weight, gradient)
        found.append(square_error)
        ctx.save_for_backward(gradient)
        return torch.tensor(loss, dtype=torch.float32)

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        return _times(ctx.saved_tensors[0], upstream), None, None, None


def _times(gradient: Tensor, upstream: Tensor) -> Tensor:
    """Usually a loss is a term of the total, with upstream 1: then no image is copied."""
    return gradient if upstream.item() == 1.0 else gradient * upstream


@dataclass(frozen=True, kw_only=True, eq=False)
class GeometryPrior:
    """What a view's geometry is compared with."""

    depth: Float[Tensor, "h w"]
    """z, scene units; NaN = none."""
    normals: Float[Tensor, "h w 3"] | Int8[Tensor, "h w 3"] | None
    """Camera axes, facing the camera. Float: unit, NaN = none. Bytes: of any length, 0 0 0 = none."""


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


def planes_depth(blended: Float[Tensor, "4 h w"], alpha: Float[Tensor, "h w"], camera: Camera) -> RenderedDepth:
    """Depth of the splats' planes, D / (N·K⁻¹p), from blended `plane_channels`; negated so that both are positive."""
    numerator, denominator = _PlaneFraction.apply(blended, _lens(camera))
    return RenderedDepth(numerator=numerator, denominator=denominator, alpha=alpha)


def _lens(camera: Camera) -> _native.Lens:
    return _native.Lens(*camera.focal_px.tolist(), *camera.centre_px.tolist(), camera.width, camera.height)


class _PlaneFraction(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, planes: Tensor, lens: _native.Lens) -> tuple[Tensor, Tensor]:
        numerator, denominator = torch.empty(planes.shape[1:]), torch.empty(planes.shape[1:])
        _native.plane_fraction(planes.detach().contiguous(), lens, numerator, denominator)
        ctx.lens = lens
        return numerator, denominator

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor, None]:
        gradient = torch.empty(4, *upstream[0].shape)
        _native.plane_fraction_backward(*(grad.contiguous() for grad in upstream), ctx.lens, gradient)
        return gradient, None


def geometry_loss(
    depth: RenderedDepth, prior: GeometryPrior, camera: Camera, depth_weight: float, normal_weight: float
) -> Float[Tensor, ""]:
    """λ_d·L_d + λ_dn·L_dn, Eq. (3) and (4), of a rendered depth D.

    L_d is the mean |D - D̂| over pixels with a prior. L_dn is the mean of alpha·(1 - N_d·N̂) over pixels with a prior,
    where N_d is the cross product of central differences of the back-projected D; alpha only weighs there, no gradient
    reaches it. Pixels with alpha ≤ 0.1 show nothing and do not count. Twin: device_losses.py.

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
        gradients = torch.empty(numerator.shape), torch.empty(numerator.shape)
        images = (image.detach().contiguous() for image in (numerator, denominator, alpha, prior.depth))
        normals = None if prior.normals is None or not weights[1] else prior.normals.contiguous()
        kinds = (None, normals) if normals is not None and normals.dtype == torch.int8 else (normals, None)
        depth, depth_normal = _geometry(*images, *kinds, _lens(camera), *weights, *gradients)
        ctx.save_for_backward(*gradients)
        return torch.tensor(weights[0] * depth + weights[1] * depth_normal, dtype=torch.float32)

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        return *(_times(gradient, upstream) for gradient in ctx.saved_tensors), None, None, None, None


def identity_loss(logits: Float[Tensor, "p k"], classes: Int16[Tensor, "p"]) -> Float[Tensor, ""]:
    """L_o: cross-entropy between predicted and given instance, mean over labelled pixels; 0 where none is."""
    if not (classes != UNLABELLED).any():
        return logits.sum() * 0.0
    return torch.nn.functional.cross_entropy(logits, classes.long(), ignore_index=UNLABELLED)
