"""`rasterize`: differentiable alpha blending of any channels, by native/raster.cpp or, on a CUDA device, by gsplat."""

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float, Int32
from torch import Tensor

from goc import _native
from goc.geometry.native_camera import native_camera
from goc.raster.gsplat_engine import blend_with_gsplat
from goc.raster.views import views_of
from goc.scene.camera import Camera
from goc.scene.gaussians import Gaussians


def rasterize(
    gaussians: Gaussians, camera: Camera, channels: Float[Tensor, "n c"]
) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"]]:
    """Blend per-splat channels front to back, Eq. (1): image = Σ channels_i α_i T_i, alpha = Σ α_i T_i.

    Differentiable in the splats' means, quats, log_scales and opacity_logits and in `channels`; not in the camera.
    Projection is the EWA approximation with a 0.3 px² low-pass filter, as in 3D Gaussian Splatting (Kerbl et al. 2023)
    and gsplat 1.5.3: alpha in [1/255, 0.999], a ray ends before its transmittance falls below 1e-4.
    The result does not depend on the number of threads. Splats on a CUDA device are drawn there, by gsplat.

    Args:
        gaussians: n splats; `sh` and `identity` are not looked at.
        camera: OpenCV axes, pixel (0, 0) centred at (0.5, 0.5).
        channels: what to blend, any c ≥ 1. The background is 0.

    Returns:
        image, and alpha in [0, 1].

    Raises:
        ValueError: channels do not have one row a splat.
    """
    if channels.shape[0] != len(gaussians):
        raise ValueError(f"channels has {channels.shape[0]} rows for {len(gaussians)} splats")
    if channels.is_cuda:
        image, alpha = blend_with_gsplat(gaussians, views_of([camera], channels.device), channels[None])
        return image[0], alpha[0]
    planes, alpha = _Rasterize.apply(
        gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits, channels, camera
    )
    return planes.permute(1, 2, 0), alpha


def median_splats(gaussians: Gaussians, camera: Camera) -> Int32[Tensor, "h w"]:
    """The splat at which each pixel's transmittance falls below one half: the surface it shows; -1 where none does.

    Found on the CPU wherever the splats are: gsplat 1.5 has no such image.
    """
    return _median(_drawn(gaussians, camera, torch.zeros(len(gaussians), 1))[2], camera).to(gaussians.means.device)


@torch.no_grad()
def rasterize_with_median(
    gaussians: Gaussians, camera: Camera, channels: Float[Tensor, "n c"]
) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"], Int32[Tensor, "h w"]]:
    """What `rasterize` and `median_splats` return, without gradients; on the CPU from one look at the splats."""
    if channels.is_cuda:
        return *rasterize(gaussians, camera, channels), median_splats(gaussians, camera)
    planes, alpha, raster = _drawn(gaussians, camera, channels)
    return planes.permute(1, 2, 0), alpha, _median(raster, camera)


def _median(raster: _native.Raster, camera: Camera) -> Int32[Tensor, "h w"]:
    out = torch.zeros(camera.height, camera.width, dtype=torch.int32)
    raster.median(out)
    return out


def _drawn(
    gaussians: Gaussians, camera: Camera, channels: Float[Tensor, "n c"]
) -> tuple[Float[Tensor, "c h w"], Float[Tensor, "h w"], _native.Raster]:
    """Images of the channels, alpha, and what is known of the view, on the CPU."""
    arrays = (gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits, channels)
    *arrays, channels = [array.detach().cpu().contiguous() for array in arrays]
    planes = torch.empty(channels.shape[1], camera.height, camera.width)
    alpha = torch.empty(camera.height, camera.width)
    raster = _native.Raster()
    raster.forward(_native.Splats(*arrays), _native.Channels(channels), native_camera(camera), [planes], alpha)
    return planes, alpha, raster


def taken_raster(ctx: Any) -> _native.Raster:
    """The raster of a forward, for its only backward: afterwards its buffers serve another view.

    Raises:
        RuntimeError: it was taken before.
    """
    raster, ctx.raster = ctx.raster, None
    if raster is None:
        raise RuntimeError("a rendered view can be differentiated once: retain_graph does not work here")
    return raster


def stacked(images: Sequence[Tensor]) -> Tensor:
    """Images of several views with the view as first axis; of one view without a copy."""
    return images[0][None] if len(images) == 1 else torch.stack(list(images))


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, means: Tensor, quats: Tensor, log_scales: Tensor, logits: Tensor, channels: Tensor, camera: Camera
    ) -> tuple[Tensor, Tensor]:
        arrays = [array.detach().contiguous() for array in (means, quats, log_scales, logits, channels)]
        planes = torch.empty(channels.shape[1], camera.height, camera.width)
        alpha = torch.empty(camera.height, camera.width)
        raster, channels = _native.Raster(), _native.Channels(arrays[4])
        raster.forward(_native.Splats(*arrays[:4]), channels, native_camera(camera), [planes], alpha)
        if any(ctx.needs_input_grad):
            ctx.save_for_backward(*arrays, planes, alpha)
            ctx.raster = raster
            ctx.set_materialize_grads(False)
        return planes, alpha

    @staticmethod
    def backward(ctx: Any, planes_grad: Tensor | None, alpha_grad: Tensor | None) -> tuple[Tensor | None, ...]:
        means, quats, log_scales, logits, channels, planes, alpha = ctx.saved_tensors
        channels_grad = torch.empty_like(channels)
        splat_grads: tuple[Tensor | None, ...] = (None, None, None, None)
        if any(ctx.needs_input_grad[:4]):
            splat_grads = tuple(torch.empty_like(array) for array in (means, quats, log_scales, logits))
        taken_raster(ctx).backward(
            _native.Splats(means, quats, log_scales, logits),
            _native.Channels(channels),
            [planes],
            alpha,
            [None if planes_grad is None else planes_grad.contiguous()],
            None if alpha_grad is None else alpha_grad.contiguous(),
            *splat_grads,
            None,
            channels_grad,
        )
        return *splat_grads, channels_grad, None
