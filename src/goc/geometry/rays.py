"""Rays of pixels through the world, as `TriangleScene` casts them."""

import numpy as np
import torch
from jaxtyping import Float64

from goc.scene.camera import Camera


def world_rays(
    camera: Camera, pixels: Float64[np.ndarray, "p 2"] | None = None
) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p 3"]]:
    """Origins and directions of rays through pixel coordinates, or through the centres of all pixels, row by row.

    Directions have z = 1 in camera axes, so that the length of a ray, in its own direction, is depth.
    """
    camera = camera.double()
    local = camera.rays().reshape(-1, 3) if pixels is None else camera.rays_through(torch.as_tensor(pixels))
    directions = (local @ camera.world_from_cam[:3, :3].T).numpy()
    return np.broadcast_to(camera.position.numpy(), directions.shape), directions
