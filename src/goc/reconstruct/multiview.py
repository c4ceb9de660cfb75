"""L_pho (Eq. 5) and L_geo of paper §4.2: what a rendered depth says of a neighbouring view."""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from goc import _native
from goc.reconstruct.losses import RenderedDepth
from goc.scene.camera import Camera
from goc.scene.capture import Frame

_multiview = _native.MultiviewLoss()

MIN_ALPHA = 0.5
"""Pixels less opaque show no surface; native/multiview.cpp has the same number."""
_MIN_DENOMINATOR = 0.01
"""Below, planes are seen edge-on."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbour:
    """The view that another one is compared with."""

    camera: Camera
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


def inverse_depth(depth: RenderedDepth) -> Float[Tensor, "h w"]:
    """1/z of a rendered depth, 0 where it shows no surface; differentiable."""
    shown = (depth.alpha > MIN_ALPHA) & (depth.denominator > _MIN_DENOMINATOR) & (depth.numerator > 0)
    return torch.where(shown, depth.denominator / torch.where(shown, depth.numerator, 1.0), 0.0)


def multiview_loss(depth: RenderedDepth, frame: Frame, neighbour: Neighbour, weights: PairWeights) -> Float[Tensor, ""]:
    """λ_pho·L_pho + λ_geo·L_geo of a view's rendered depth D and one neighbour (docs/decisions/0016).

    D carries each pixel p to a place q in the neighbour. L_pho compares the photograph C with C̃(p), the neighbour's
    photograph at q: the mean of 0.85·(1 - SSIM)/2 + 0.15·|C - C̃| over pixels whose 3×3 block is all in the neighbour's
    frame and not hidden behind its surface. L_geo goes on to the neighbour's own surface at q and back into the view,
    where it arrives at p': the mean of exp(-e)·e, e = |p' - p| in pixels, over pixels whose q is on one surface; those
    with e ≥ 1 show two surfaces and add 0. Gradients leave the factor exp(-e) alone. Pixels with alpha ≤ 0.5 do not
    count, and a mean is over a quarter of the view's pixels at least. Twin: device_pairs.py.

    Args:
        depth: D, by either definition; differentiable.
        frame: the view.
        neighbour: another view of the same surface.
        weights: λ_pho, λ_geo and what counts as hidden.
    """
    return _Multiview.apply(
        depth.numerator, depth.denominator, neighbour.inverse_depth, depth.alpha, (frame, neighbour, weights)
    )


def _lens(camera: Camera, image: Tensor, stride: int = 1) -> _native.Lens:
    """Intrinsics of every `stride`-th pixel of a view."""
    numbers = [value / stride for value in (*camera.focal_px.tolist(), *camera.centre_px.tolist())]
    return _native.Lens(*numbers, image.shape[1], image.shape[0])


class _Multiview(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        numerator: Tensor,
        denominator: Tensor,
        inverse: Tensor,
        alpha: Tensor,
        pair: tuple[Frame, Neighbour, PairWeights],
    ) -> Tensor:
        frame, neighbour, weights = pair
        images = [image.detach().contiguous() for image in (numerator, denominator, alpha)]
        there = neighbour.camera
        from_view = (there.cam_from_world.double() @ frame.camera.world_from_cam.double())[:3].float().contiguous()
        photograph = neighbour.image, _lens(there, neighbour.image)
        known = inverse.detach().contiguous(), _lens(there, inverse, neighbour.stride)
        source = _native.WarpSource(*photograph, *known, from_view)
        gradients = torch.empty(2, *numerator.shape)
        pulls = torch.empty(inverse.shape) if ctx.needs_input_grad[2] else None
        photometric, geometric = _multiview(
            _native.WarpedView(*images, frame.image, _lens(frame.camera, numerator)),
            source,
            weights.photometric,
            weights.geometric,
            weights.tolerance,
            *gradients,
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
