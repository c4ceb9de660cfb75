"""`rasterize`: differentiable alpha blending of any channels on the CPU, by native/raster.cpp."""

from typing import Any

import torch
from jaxtyping import Bool, Float, Int32
from torch import Tensor

from goc import _native
from goc.scene.camera import Camera
from goc.scene.gaussians import Gaussians

_idle_rasters: list[_native.Raster] = []  # buffers of finished views, so that a step allocates nothing


def rasterize(
    gaussians: Gaussians, camera: Camera, channels: Float[Tensor, "n c"]
) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"]]:
    """Blend per-splat channels front to back, Eq. (1): image = Σ channels_i α_i T_i, alpha = Σ α_i T_i.

    Differentiable in the splats' means, quats, log_scales and opacity_logits and in `channels`; not in the camera.
    Projection is the EWA approximation with a 0.3 px² low-pass filter, as in 3D Gaussian Splatting (Kerbl et al. 2023)
    and gsplat 1.5.3: alpha in [1/255, 0.999], a ray ends before its transmittance falls below 1e-4.
    The result does not depend on the number of threads.

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
    planes, alpha = _Rasterize.apply(
        gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits, channels, camera
    )
    return planes.permute(1, 2, 0), alpha


def median_splats(gaussians: Gaussians, camera: Camera) -> Int32[Tensor, "h w"]:
    """The splat at which each pixel's transmittance falls below one half: the surface it shows; -1 where none does."""
    raster, _, _ = _forward(_splats(gaussians), camera, torch.zeros(len(gaussians), 1))
    out = torch.zeros(camera.height, camera.width, dtype=torch.int32)
    raster.median(out)
    _idle_rasters.append(raster)
    return out


def visible_splats(gaussians: Gaussians, camera: Camera) -> Bool[Tensor, "n"]:
    """Splats that reach alpha 1/255 somewhere in the view, whatever stands before them."""
    raster, _, _ = _forward(_splats(gaussians), camera, torch.zeros(len(gaussians), 1))
    out = torch.zeros(len(gaussians), dtype=torch.uint8)
    raster.visible(out)
    _idle_rasters.append(raster)
    return out.bool()


def _splats(gaussians: Gaussians) -> _native.Splats:
    arrays = (gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits)
    return _native.Splats(*(array.detach().contiguous() for array in arrays))


def _forward(
    splats: _native.Splats, camera: Camera, channels: Float[Tensor, "n c"]
) -> tuple[_native.Raster, Float[Tensor, "c h w"], Float[Tensor, "h w"]]:
    focal, centre = camera.focal_px.tolist(), camera.centre_px.tolist()
    view = _native.RasterCamera(camera.cam_from_world.contiguous(), *focal, *centre, camera.width, camera.height)
    planes = torch.empty(channels.shape[1], camera.height, camera.width)
    alpha = torch.empty(camera.height, camera.width)
    raster = _idle_rasters.pop() if _idle_rasters else _native.Raster()
    raster.forward(splats, view, channels, planes, alpha)
    return raster, planes, alpha


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, means: Tensor, quats: Tensor, log_scales: Tensor, logits: Tensor, channels: Tensor, camera: Camera
    ) -> tuple[Tensor, Tensor]:
        arrays = [array.detach().contiguous() for array in (means, quats, log_scales, logits, channels)]
        raster, planes, alpha = _forward(_native.Splats(*arrays[:4]), camera, arrays[4])
        if any(ctx.needs_input_grad):
            ctx.save_for_backward(*arrays, planes, alpha)
            ctx.raster = raster
            ctx.set_materialize_grads(False)
        else:
            _idle_rasters.append(raster)
        return planes, alpha

    @staticmethod
    def backward(ctx: Any, planes_grad: Tensor | None, alpha_grad: Tensor | None) -> tuple[Tensor | None, ...]:
        means, quats, log_scales, logits, channels, planes, alpha = ctx.saved_tensors
        upstream = torch.zeros_like(planes) if planes_grad is None else planes_grad.contiguous()
        channels_grad = torch.zeros_like(channels)
        splat_grads: tuple[Tensor | None, ...] = (None, None, None, None)
        if any(ctx.needs_input_grad[:4]):
            splat_grads = tuple(torch.zeros_like(array) for array in (means, quats, log_scales, logits))
        ctx.raster.backward(
            _native.Splats(means, quats, log_scales, logits),
            channels,
            planes,
            alpha,
            upstream,
            None if alpha_grad is None else alpha_grad.contiguous(),
            channels_grad,
            *splat_grads,
        )
        return *splat_grads, channels_grad, None
