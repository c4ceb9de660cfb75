"""A posed pinhole camera: projection of world points into its image, and rays through its pixels."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor


@dataclass(frozen=True, kw_only=True, eq=False)  # eq=False: arrays have no truth value
class Camera:
    """A posed pinhole camera: x right, y down, z forward; pixel (0, 0) is centred at (0.5, 0.5).

    Points and directions are rows, z is depth along the optical axis, all in scene units. Methods compute in the wider
    dtype of the camera and the argument, on the camera's device, and are differentiable in the argument.
    """

    focal_px: Float[Tensor, "2"]
    centre_px: Float[Tensor, "2"]
    width: int
    height: int
    world_from_cam: Float[Tensor, "4 4"]
    """Rigid pose, scene units."""

    @property
    def cam_from_world(self) -> Float[Tensor, "4 4"]:
        """Inverse of the rigid pose."""
        rotation = self.world_from_cam[:3, :3].T
        inverse = torch.eye(4, dtype=rotation.dtype, device=rotation.device)
        inverse[:3, :3] = rotation
        inverse[:3, 3] = -rotation @ self.world_from_cam[:3, 3]
        return inverse

    @property
    def position(self) -> Float[Tensor, "3"]:
        """Centre of projection, world."""
        return self.world_from_cam[:3, 3]

    def to(self, device: torch.device | None = None, dtype: torch.dtype | None = None) -> "Camera":
        """Return the camera on a device and in a dtype; None keeps the present one. Copies only what changes."""
        now = self.world_from_cam
        device, dtype = device or now.device, dtype or now.dtype
        if (now.device, now.dtype) == (device, dtype):
            return self
        moved = {name: getattr(self, name).to(device, dtype) for name in ("focal_px", "centre_px", "world_from_cam")}
        return replace(self, **moved)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as NumPy arrays and unpickle on the CPU: torch would send an open file handle for each tensor."""
        tensors = (self.focal_px, self.centre_px, self.world_from_cam)
        return _camera_of, (self.width, self.height, *(tensor.detach().cpu().numpy() for tensor in tensors))

    def double(self) -> "Camera":
        """Return the camera in float64, for geometry that rounding in float32 would change."""
        return self.to(dtype=torch.float64)

    def resized(self, width: int, height: int) -> "Camera":
        """Return the camera of the same view for an image of another size."""
        scale = torch.tensor([width / self.width, height / self.height], dtype=self.focal_px.dtype)
        return replace(
            self, focal_px=self.focal_px * scale, centre_px=self.centre_px * scale, width=width, height=height
        )

    def in_camera(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """Map world points to camera axes."""
        return _carried(points, self._widened(points).cam_from_world)

    def in_world(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """Map points in camera axes to the world."""
        return _carried(points, self._widened(points).world_from_cam)

    def project(self, points: Float[Tensor, "*b 3"]) -> tuple[Float[Tensor, "*b 2"], Float[Tensor, "*b"]]:
        """Project world points into the image.

        Returns:
            Pixel coordinates, also of points outside the frame; NaN where z is not positive, since such a point has no
            pixel. Then z in scene units, of either sign.
        """
        local = self.in_camera(points)
        z = local[..., 2]
        ahead = torch.where(z > 0, z, torch.nan)
        return local[..., :2] / ahead[..., None] * self.focal_px + self.centre_px, z

    def unproject(self, pixels: Float[Tensor, "*b 2"], z: Float[Tensor, "*b"]) -> Float[Tensor, "*b 3"]:
        """Return the world points at pixel coordinates and z, the inverse of `project`; NaN where z is NaN."""
        return self.in_world(self.rays_through(pixels) * z[..., None])

    def unproject_depth(self, depth: Float[Tensor, "h w"]) -> Float[Tensor, "h w 3"]:
        """Return the world points of a z-depth image at its pixel centres; NaN where depth is NaN."""
        return self.in_world(self.rays() * depth[..., None])

    def rays_through(self, pixels: Float[Tensor, "*b 2"]) -> Float[Tensor, "*b 3"]:
        """Rays K⁻¹p through pixel coordinates, camera axes, with z = 1; times a depth z, they are points."""
        return torch.nn.functional.pad((pixels - self.centre_px) / self.focal_px, (0, 1), value=1.0)

    def rays(self) -> Float[Tensor, "h w 3"]:
        """Rays through the centre of every pixel, camera axes, with z = 1."""
        shape = (self.height, self.width)
        x = (self._steps(self.width) - self.centre_px[0]) / self.focal_px[0]
        y = (self._steps(self.height) - self.centre_px[1]) / self.focal_px[1]
        return torch.stack([x.expand(shape), y[:, None].expand(shape), torch.ones_like(x).expand(shape)], -1)

    def sees(self, points: Float[Tensor, "*b 3"]) -> Bool[Tensor, "*b"]:
        """Tell which world points are in front of the camera and inside its frame, borders included."""
        pixels, _ = self.project(points)
        size = torch.tensor([self.width, self.height], device=pixels.device)
        return ((pixels >= 0) & (pixels <= size)).all(-1)  # False for NaN

    def _widened(self, values: Tensor) -> "Camera":
        return self.to(dtype=torch.promote_types(self.world_from_cam.dtype, values.dtype))

    def _steps(self, count: int) -> Float[Tensor, "_"]:
        return torch.arange(count, dtype=self.focal_px.dtype, device=self.focal_px.device) + 0.5


def _camera_of(width: int, height: int, focal_px: np.ndarray, centre_px: np.ndarray, pose: np.ndarray) -> Camera:
    return Camera(
        focal_px=torch.tensor(focal_px),
        centre_px=torch.tensor(centre_px),
        width=width,
        height=height,
        world_from_cam=torch.tensor(pose),
    )


def _carried(points: Float[Tensor, "*b 3"], pose: Float[Tensor, "4 4"]) -> Float[Tensor, "*b 3"]:
    return points.to(pose.dtype) @ pose[:3, :3].T + pose[:3, 3]
