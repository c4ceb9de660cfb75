"""L_d and L_dn, Eq. (3) and (4): rendered depth and its normals against given ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float, Int8
from torch import Tensor

from goc import _native
from goc.raster import Views
from goc.reconstruct import kernels
from goc.reconstruct.losses.depth import MIN_DENOMINATOR, RenderedDepth

_MIN_ALPHA = 0.1
"""Below, nothing worth a depth was rendered; native/lanes/geometry.cpp has the same number."""
_kernel = _native.GeometryLoss()


@dataclass(frozen=True, kw_only=True, eq=False)
class GeometryPrior:
    """What the geometry of a batch of views is compared with."""

    depth: Float[Tensor, "v h w"]
    """z, scene units; NaN = none."""
    normals: Float[Tensor, "v h w 3"] | Int8[Tensor, "v h w 3"] | None
    """Camera axes, facing the camera. Float: unit, NaN = none. Bytes: of any length, 0 0 0 = none."""


def stacked_priors(priors: Sequence[GeometryPrior | None]) -> GeometryPrior | None:
    """One prior of all views, NaN for a view that has none; None where no view has one."""
    given = [prior for prior in priors if prior is not None]
    if len(given) == len(priors) == 1 or not given:
        return given[0] if given else None
    blank = torch.full_like(given[0].depth, torch.nan)
    depth = torch.cat([blank if prior is None else prior.depth for prior in priors])
    if all(prior.normals is None for prior in given):
        return GeometryPrior(depth=depth, normals=None)
    nowhere = blank[..., None].expand(*blank.shape, 3)
    parts = [nowhere if prior is None or prior.normals is None else unit_normals(prior.normals) for prior in priors]
    return GeometryPrior(depth=depth, normals=torch.cat(parts))


def unit_normals(normals: Float[Tensor, "v h w 3"] | Int8[Tensor, "v h w 3"]) -> Float[Tensor, "v h w 3"]:
    """Normals of a prior in one form: unit, NaN = none."""
    if normals.dtype != torch.int8:
        return normals
    long = normals.float()
    length = long.norm(dim=-1, keepdim=True)
    return torch.where(length > 0, long / length, torch.nan)


def geometry_loss(
    depth: RenderedDepth, prior: GeometryPrior, views: Views, depth_weight: float, normal_weight: float
) -> Float[Tensor, ""]:
    """λ_d·L_d + λ_dn·L_dn of rendered depths D, means over the valid pixels of each view, then over the views.

    L_d is the mean |D - D̂| over pixels with a prior. L_dn is the mean of alpha·(1 - N_d·N̂) over pixels with a prior,
    where N_d is the cross product of central differences of the back-projected D; alpha only weighs there, no gradient
    reaches it. Pixels with alpha ≤ 0.1 show nothing and do not count. Means, where the paper has sums: no weight
    depends on the resolution.

    Args:
        depth: D, by either definition.
        prior: depth and normals to compare with.
        views: that were rendered.
        depth_weight: λ_d, per scene unit.
        normal_weight: λ_dn.
    """
    weights = depth_weight, normal_weight
    if kernels.natively(depth.numerator):
        return _Geometry.apply(depth.numerator, depth.denominator, depth.alpha, prior, views.native_cameras, weights)
    return geometry(depth, prior, views, weights)


def geometry(
    depth: RenderedDepth, prior: GeometryPrior, views: Views, weights: tuple[float, float]
) -> Float[Tensor, ""]:
    """Both losses in PyTorch."""
    shown = (depth.alpha > _MIN_ALPHA) & (depth.denominator > MIN_DENOMINATOR)
    z = torch.where(shown, depth.numerator, 0.0) / torch.where(shown, depth.denominator, 1.0)
    known = shown & torch.isfinite(prior.depth)
    off = (z - torch.where(known, prior.depth, 0.0)).abs()
    loss = weights[0] * _mean_of_views(off, known)
    if prior.normals is None or not weights[1]:
        return loss
    normals, met = _normals(z, shown, views.rays)
    given = unit_normals(prior.normals)[:, 1:-1, 1:-1]
    met = met & torch.isfinite(given).all(-1)
    cosine = (normals * torch.where(met[..., None], given, 0.0)).sum(-1)
    off = depth.alpha.detach()[:, 1:-1, 1:-1] * (1.0 - cosine)
    return loss + weights[1] * _mean_of_views(off, met)


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


class _Geometry(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        numerator: Tensor,
        denominator: Tensor,
        alpha: Tensor,
        prior: GeometryPrior,
        cameras: tuple[_native.Camera, ...],
        weights: tuple[float, float],
    ) -> Tensor:
        count, total = len(cameras), 0.0
        gradients = torch.empty(numerator.shape), torch.empty(numerator.shape)
        images = [image.detach().contiguous() for image in (numerator, denominator, alpha, prior.depth)]
        normals = None if prior.normals is None or not weights[1] else prior.normals.contiguous()
        for k, camera in enumerate(cameras):
            own = None if normals is None else normals[k]
            kinds = (None, own) if own is not None and own.dtype == torch.int8 else (own, None)
            shown, outputs = [image[k] for image in images], [gradient[k] for gradient in gradients]
            depth, depth_normal = _kernel(*shown, *kinds, camera, *weights, *outputs)
            total += weights[0] * depth + weights[1] * depth_normal
        ctx.save_for_backward(*(gradient if count == 1 else gradient / count for gradient in gradients))
        return torch.tensor(total / count, dtype=torch.float32)

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        return *(kernels.scaled(gradient, upstream) for gradient in ctx.saved_tensors), None, None, None, None
