"""Rays of pixels, and points from depth."""

import torch
from jaxtyping import Float
from torch import Tensor

from goc.scene.camera import Camera


def pixel_rays(camera: Camera) -> Float[Tensor, "h w 3"]:
    """K⁻¹p of each pixel centre, camera axes, z = 1: times z depth it is the point seen there."""
    device, shape = camera.focal_px.device, (camera.height, camera.width)
    x = (torch.arange(camera.width, device=device) + 0.5 - camera.centre_px[0]) / camera.focal_px[0]
    y = (torch.arange(camera.height, device=device) + 0.5 - camera.centre_px[1]) / camera.focal_px[1]
    return torch.stack([x.expand(shape), y[:, None].expand(shape), torch.ones(shape, device=device)], -1)


def points_from_depth(depth: Float[Tensor, "h w"], camera: Camera) -> Float[Tensor, "h w 3"]:
    """The points a z-depth image sees, world; NaN where depth is."""
    points = pixel_rays(camera) * depth[..., None]
    return points @ camera.world_from_cam[:3, :3].T + camera.world_from_cam[:3, 3]
