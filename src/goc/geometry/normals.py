"""Normals of a depth image."""

import torch
from jaxtyping import Float
from torch import Tensor

from goc import _native
from goc.geometry.native_camera import native_camera
from goc.scene.camera import Camera


def normals_from_depth(depth: Float[Tensor, "h w"], camera: Camera) -> Float[Tensor, "h w 3"]:
    """Unit normals of the surface a z-depth image samples, camera axes, facing the camera (paper §4.2, N_d).

    Cross product of central differences of the back-projected points; differentiable. The one-pixel border, and
    pixels with a missing neighbour, are NaN.
    """
    points = camera.rays() * depth[..., None]
    right = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    inner = torch.nn.functional.normalize(torch.cross(down, right, dim=-1), dim=-1, eps=1e-12)
    return torch.nn.functional.pad(inner, (0, 0, 1, 1, 1, 1), value=torch.nan)


def fitting_radius(depth: Float[Tensor, "h w"], camera: Camera) -> int:
    """Half-width, 1 to 4 pixels, of the smallest window in which noise tilts a fitted plane by less than 0.05 rad.

    The noise is read off the depth itself: the median second difference along rows, over √6, which is 0 on a plane
    up to perspective. Tilt = noise / (pixel pitch · √Σu²) over the window's pixel offsets u.
    """
    inverse = 1.0 / depth
    second = inverse[:, 2:] + inverse[:, :-2] - 2.0 * inverse[:, 1:-1]
    noise = second.abs() * depth[:, 1:-1].square() / (6.0**0.5 * 0.6745)
    pitch = depth[:, 1:-1] / camera.focal_px[0]
    ratio = (noise / pitch)[torch.isfinite(noise)]
    if len(ratio) == 0:
        return 1
    tilt = ratio.median().item()
    for radius in (1, 2, 3):
        spread = ((2 * radius + 1) ** 2 * radius * (radius + 1) / 3.0) ** 0.5
        if tilt / spread < 0.05:
            return radius
    return 4


_AGREE = 0.05
"""Neighbours within this share of a pixel's depth lie on its surface."""


def fitted_normals(depth: Float[Tensor, "h w"], camera: Camera, radius: int) -> Float[Tensor, "h w 3"]:
    """Normals of planes fitted to windows of a z-depth image, unit, camera axes, facing the camera; NaN = none.

    On a plane inverse depth is linear in the pixel: 1/z = A·u + B·v + C on rays (u, v, 1), with normal ∝ (A, B, C).
    Least squares over the window's pixels within 5 % of the middle's depth, so that the fit stays on one side of an
    edge; at least half of the window must be there. Twin: tests/oracles/normals.py.
    """
    normals = torch.zeros(*depth.shape, 3)
    fewest = (2 * radius + 1) ** 2 // 2 + 1
    _native.plane_normals(depth.contiguous().numpy(), native_camera(camera), radius, _AGREE, fewest, normals.numpy())
    return normals
