"""Normals of a depth image."""

import torch
from jaxtyping import Float
from torch import Tensor

from goc.geometry.rays import pixel_rays
from goc.scene.camera import Camera


def normals_from_depth(depth: Float[Tensor, "h w"], camera: Camera) -> Float[Tensor, "h w 3"]:
    """Unit normals of the surface a z-depth image samples, camera axes, facing the camera (paper §4.2, N_d).

    Cross product of central differences of the back-projected points; differentiable. The one-pixel border, and
    pixels with a missing neighbour, are NaN.
    """
    points = pixel_rays(camera) * depth[..., None]
    right = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    inner = torch.nn.functional.normalize(torch.linalg.cross(down, right), dim=-1, eps=1e-12)
    return torch.nn.functional.pad(inner, (0, 0, 1, 1, 1, 1), value=torch.nan)
