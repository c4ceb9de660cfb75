"""Blending on a CUDA device by gsplat (Ye et al. 2025, Apache-2.0); the one module that imports it."""

from jaxtyping import Float
from torch import Tensor

from goc import _native
from goc.raster.views import Views
from goc.scene.gaussians import Gaussians


def blend_with_gsplat(
    gaussians: Gaussians, views: Views, channels: Float[Tensor, "v n c"]
) -> tuple[Float[Tensor, "v h w c"], Float[Tensor, "v h w"]]:
    """As `rasterize`, for several views in one call, with the constants of the CPU engine.

    gsplat 1.5 has the same bounds of alpha, transmittance floor and field-of-view clamp; 1.6 cuts alpha off at 0.99.
    Not packed: most of a room is in view, and packing waits for the device once more.
    """
    import gsplat

    image, alpha, _ = gsplat.rasterization(
        means=gaussians.means,
        quats=gaussians.quats,
        scales=gaussians.log_scales.exp(),
        opacities=gaussians.opacity_logits.sigmoid(),
        colors=channels,
        viewmats=views.cam_from_world,
        Ks=views.intrinsics,
        width=views.width,
        height=views.height,
        near_plane=_native.NEAR,
        eps2d=_native.DILATION,
        packed=False,
        channel_chunk=32,
    )
    return image, alpha[..., 0]
