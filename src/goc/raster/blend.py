"""`blend_views`: what a training step renders of a batch of views; on the processor in one native call a view."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from goc import _native
from goc.raster.engine import Engine
from goc.raster.rasterize import stacked, taken_raster
from goc.raster.views import Views, view_channels
from goc.scene.gaussians import Gaussians


@dataclass(frozen=True, kw_only=True, eq=False)
class BlendedViews:
    """Blended images of views of one size, channel by channel; losses differentiate in each of them."""

    colour: Float[Tensor, "v 3 h w"]
    """sRGB over black, not clamped."""
    geometry: Float[Tensor, "v g h w"]
    """Four `plane_channels`, or one of `centre_depths`."""
    features: Float[Tensor, "v f h w"] | None
    """Blended `Gaussians.identity`, where splats have it."""
    alpha: Float[Tensor, "v h w"]


def blend_views(gaussians: Gaussians, views: Views, planes: bool, engine: Engine) -> BlendedViews:
    """Blend colours, planes (or the z of centres) and features of the splats, as `rasterize` blends their channels.

    The same as rasterize(gaussians, camera, channels) of each view with channels = [colours_towards, plane_channels if
    `planes` else centre_depths, identity], its twin in the tests. A fused engine makes and differentiates channels
    splat by splat, for those in view. Differentiable in everything that `gaussians` holds, once.
    """
    if engine.fused:
        return _fused(gaussians, views, planes)
    blended, alpha = engine.blend(gaussians, views, view_channels(gaussians, views, planes))
    image, first = blended.permute(0, 3, 1, 2), 7 if planes else 4
    width = 0 if gaussians.identity is None else gaussians.identity.shape[1]
    return BlendedViews(
        colour=image[:, :3],
        geometry=image[:, 3:first],
        features=image[:, first : first + width] if width else None,
        alpha=alpha,
    )


def _fused(gaussians: Gaussians, views: Views, planes: bool) -> BlendedViews:
    splats = gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits
    drawn: Sequence[tuple[Tensor, ...]] = [
        _BlendView.apply(*splats, gaussians.sh, gaussians.identity, camera, planes, (views.height, views.width))
        for camera in views.native_cameras
    ]
    *images, alpha = (stacked(parts) for parts in zip(*drawn, strict=True))
    return BlendedViews(
        colour=images[0], geometry=images[1], features=images[2] if len(images) > 2 else None, alpha=alpha
    )


class _BlendView(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[Tensor, ...]:
        *parameters, camera, planes, size = arguments
        arrays = [None if array is None else array.detach().contiguous() for array in parameters]
        counts = [3, 4 if planes else 1] + ([] if arrays[5] is None else [arrays[5].shape[1]])
        images = [torch.empty(count, *size) for count in counts]
        alpha = torch.empty(*size)
        raster = _native.Raster()
        channels = _native.Channels(arrays[5], arrays[4], planes)
        raster.forward(_native.Splats(*arrays[:4]), channels, camera, images, alpha)
        if any(ctx.needs_input_grad):
            ctx.save_for_backward(*arrays, *images, alpha)
            ctx.raster, ctx.planes = raster, planes
            ctx.set_materialize_grads(False)
        return *images, alpha

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor | None) -> tuple[Tensor | None, ...]:
        arrays, (*images, alpha) = ctx.saved_tensors[:6], ctx.saved_tensors[6:]
        gradients = [None if array is None else torch.empty_like(array) for array in arrays]
        *image_grads, alpha_grad = [None if grad is None else grad.contiguous() for grad in upstream]
        channels = _native.Channels(arrays[5], arrays[4], ctx.planes)
        taken_raster(ctx).backward(
            _native.Splats(*arrays[:4]), channels, images, alpha, image_grads, alpha_grad, *gradients
        )
        return *gradients, None, None, None
