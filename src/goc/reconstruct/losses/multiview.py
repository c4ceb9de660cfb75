"""L_pho (Eq. 5) and L_geo of paper §4.2: what a rendered depth says of a neighbouring view."""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from goc import _native
from goc.raster import Views
from goc.reconstruct import kernels
from goc.reconstruct.losses.depth import RenderedDepth
from goc.reconstruct.losses.warp import Photograph, geometric_error, photometric_error, warped

_kernel = _native.MultiviewLoss()


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbour:
    """The view that another one is compared with."""

    views: Views
    """This one alone."""
    image: UInt8[Tensor, "h w 3"]
    inverse_depth: Float[Tensor, "i j"]
    """1/z of what it shows, per scene unit, 0 = none: of every `stride`-th pixel (stride odd, the middle one of each
    block). It may carry a gradient, which L_geo then reaches."""
    stride: int = 1


@dataclass(frozen=True, kw_only=True)
class PairWeights:
    """What a pair of views is worth."""

    photometric: float
    """λ_pho."""
    geometric: float
    """λ_geo, per pixel."""
    tolerance: float
    """Depths within this share of each other show one surface."""


def multiview_loss(
    depth: RenderedDepth, views: Views, image: UInt8[Tensor, "h w 3"], neighbour: Neighbour, weights: PairWeights
) -> Float[Tensor, ""]:
    """λ_pho·L_pho + λ_geo·L_geo of one view's rendered depth D and one neighbour (docs/decisions/0016).

    D carries each pixel p to a place q in the neighbour. L_pho compares the photograph C with C̃(p), the neighbour's
    photograph at q: the mean of 0.85·(1 - SSIM)/2 + 0.15·|C - C̃| over pixels whose 3×3 block is all in the neighbour's
    frame and not hidden behind its surface. L_geo goes on to the neighbour's own surface at q and back into the view,
    where it arrives at p': the mean of exp(-e)·e, e = |p' - p| in pixels, over pixels whose q is on one surface; those
    with e ≥ 1 show two surfaces and add 0. Gradients leave the factor exp(-e) alone. Pixels with alpha ≤ 0.5 do not
    count, and a mean is over a quarter of the view's pixels at least.

    Args:
        depth: D of this view alone, by either definition; differentiable.
        views: the view, alone.
        image: its photograph.
        neighbour: another view of the same surface.
        weights: λ_pho, λ_geo and what counts as hidden.

    Raises:
        ValueError: an image has not the size of its view.
    """
    if kernels.natively(depth.numerator):
        pair = views, image, neighbour, weights
        return _Multiview.apply(depth.numerator, depth.denominator, neighbour.inverse_depth, depth.alpha, pair)
    return multiview(depth, views, image, neighbour, weights)


def multiview(
    depth: RenderedDepth, views: Views, image: UInt8[Tensor, "h w 3"], neighbour: Neighbour, weights: PairWeights
) -> Float[Tensor, ""]:
    """Both losses in PyTorch."""
    precision = depth.numerator.dtype
    here = Photograph(views=views, image=_unit_range(image, precision))
    there = Photograph(views=neighbour.views, image=_unit_range(neighbour.image, precision))
    warp = warped(depth, views, neighbour.views, neighbour.inverse_depth, neighbour.stride, weights.tolerance)
    loss = warp.z.new_zeros(())
    if weights.photometric:
        loss = loss + weights.photometric * photometric_error(warp, here, there, weights.tolerance)
    if weights.geometric:
        loss = loss + weights.geometric * geometric_error(warp, views, neighbour.views)
    return loss


def _unit_range(image: UInt8[Tensor, "h w 3"], precision: torch.dtype) -> Float[Tensor, "3 h w"]:
    return image.permute(2, 0, 1).to(precision) / 255.0


class _Multiview(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        numerator: Tensor,
        denominator: Tensor,
        inverse: Tensor,
        alpha: Tensor,
        pair: tuple[Views, Tensor, Neighbour, PairWeights],
    ) -> Tensor:
        views, image, neighbour, weights = pair
        (here,), (there,) = views.native_cameras, neighbour.views.native_cameras
        drawn = [part.detach()[0].contiguous() for part in (numerator, denominator, alpha)]
        known = inverse.detach().contiguous()
        gradients = torch.empty(2, *numerator.shape)
        pulls = torch.empty(inverse.shape) if ctx.needs_input_grad[2] else None
        photometric, geometric = _kernel(
            _native.WarpedView(*drawn, image, here),
            _native.WarpSource(neighbour.image, there, known, neighbour.stride),
            weights.photometric,
            weights.geometric,
            weights.tolerance,
            *gradients[:, 0],
            pulls,
        )
        ctx.save_for_backward(gradients, *([] if pulls is None else [pulls]))
        total = weights.photometric * photometric + weights.geometric * geometric
        return torch.tensor(total, dtype=torch.float32)

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        gradients, *pulls = ctx.saved_tensors
        pulled = pulls[0] * upstream if pulls else None
        return gradients[0] * upstream, gradients[1] * upstream, pulled, None, None
