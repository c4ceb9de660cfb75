"""The depth that losses see: a fraction of blended channels, by either definition."""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from goc import _native
from goc.raster import Views
from goc.reconstruct import kernels

MIN_DENOMINATOR = 0.01
"""Below, planes are seen edge-on; native/lanes/geometry.cpp and native/multiview.cpp have the same number."""
MIN_ALPHA_OF_SURFACE = 0.5
"""Pixels less opaque show no surface to compare with a neighbour's; native/multiview.cpp has the same number."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedDepth:
    """Rendered depths of a batch of views of one size, as fractions of blended channels; both are differentiable."""

    numerator: Float[Tensor, "v h w"]
    denominator: Float[Tensor, "v h w"]
    """Positive where there is a depth."""
    alpha: Float[Tensor, "v h w"]
    """Accumulated opacity."""

    def apart(self) -> "list[RenderedDepth]":
        """Each view by itself."""
        if len(self.alpha) == 1:
            return [self]  # slices would copy their gradients
        parts = zip(self.numerator.split(1), self.denominator.split(1), self.alpha.split(1), strict=True)
        return [RenderedDepth(numerator=n, denominator=d, alpha=a) for n, d, a in parts]


def rendered_depth(geometry: Float[Tensor, "v g h w"], alpha: Float[Tensor, "v h w"], views: Views) -> RenderedDepth:
    """Depth of blended planes, D / (N·K⁻¹p), or of blended centres, Eq. (2).

    Args:
        geometry: four blended `plane_channels`; both sides of their fraction are negated so that they are positive. Or
            one blended `centre_depths`, Σ z α T: over alpha it is the depth of the splats' centres, which is biased
            towards the camera on slanted surfaces.
        alpha: accumulated opacity.
        views: that were rendered.
    """
    if geometry.shape[1] == 1:
        return RenderedDepth(numerator=geometry.squeeze(1), denominator=alpha, alpha=alpha)
    if kernels.natively(geometry):
        numerator, denominator = _PlaneFraction.apply(geometry, views.native_cameras)
    else:
        numerator, denominator = plane_fraction(geometry, views)
    return RenderedDepth(numerator=numerator, denominator=denominator, alpha=alpha)


def plane_fraction(
    planes: Float[Tensor, "v 4 h w"], views: Views
) -> tuple[Float[Tensor, "v h w"], Float[Tensor, "v h w"]]:
    """-D and -N·K⁻¹p, in PyTorch."""
    x, y = views.rays
    return -planes[:, 3], -(planes[:, 0] * x + planes[:, 1] * y + planes[:, 2])


class _PlaneFraction(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, planes: Tensor, cameras: tuple[_native.Camera, ...]) -> tuple[Tensor, Tensor]:
        count, _, *size = planes.shape
        numerator, denominator = torch.empty(count, *size), torch.empty(count, *size)
        ctx.cameras = cameras
        for image, camera, n, d in zip(planes.detach().contiguous(), cameras, numerator, denominator, strict=True):
            _native.plane_fraction(image, camera, n, d)
        return numerator, denominator

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor, None]:
        count, *size = upstream[0].shape
        gradient = torch.empty(count, 4, *size)
        numerator, denominator = (grad.contiguous() for grad in upstream)
        for n, d, camera, out in zip(numerator, denominator, ctx.cameras, gradient, strict=True):
            _native.plane_fraction_backward(n, d, camera, out)
        return gradient, None


def inverse_depth(depth: RenderedDepth) -> Float[Tensor, "v h w"]:
    """1/z of a rendered depth, 0 where it shows no surface; differentiable."""
    shown = surface_shown(depth)
    return torch.where(shown, depth.denominator / torch.where(shown, depth.numerator, 1.0), 0.0)


def surface_shown(depth: RenderedDepth) -> Tensor:
    """Whether a pixel (v h w) shows a surface: opaque enough, not edge-on, before the camera."""
    return (depth.alpha > MIN_ALPHA_OF_SURFACE) & (depth.denominator > MIN_DENOMINATOR) & (depth.numerator > 0)
