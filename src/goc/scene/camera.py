"""A posed pinhole camera."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True, kw_only=True, eq=False)  # eq=False: arrays have no truth value
class Camera:
    """A posed pinhole camera: x right, y down, z forward; pixel (0, 0) is centred at (0.5, 0.5)."""

    focal_px: Float[Tensor, "2"]
    centre_px: Float[Tensor, "2"]
    width: int
    height: int
    world_from_cam: Float[Tensor, "4 4"]
    """Rigid pose, metres."""

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

    def to(self, device: torch.device) -> "Camera":
        """The same camera with its numbers on a device; itself where they are there."""
        if self.world_from_cam.device == device:
            return self
        moved = {name: getattr(self, name).to(device) for name in ("focal_px", "centre_px", "world_from_cam")}
        return replace(self, **moved)

    def __reduce__(self) -> tuple[Any, ...]:
        """Sent as arrays, and arrives on the processor: of a tensor, torch would send a handle of an open file each."""
        tensors = (self.focal_px, self.centre_px, self.world_from_cam)
        return _camera_of, (self.width, self.height, *(tensor.detach().cpu().numpy() for tensor in tensors))

    def resized(self, width: int, height: int) -> "Camera":
        """The same view on another pixel raster."""
        scale = torch.tensor([width / self.width, height / self.height], dtype=self.focal_px.dtype)
        return replace(
            self, focal_px=self.focal_px * scale, centre_px=self.centre_px * scale, width=width, height=height
        )


def _camera_of(width: int, height: int, focal_px: np.ndarray, centre_px: np.ndarray, pose: np.ndarray) -> Camera:
    return Camera(
        focal_px=torch.tensor(focal_px),
        centre_px=torch.tensor(centre_px),
        width=width,
        height=height,
        world_from_cam=torch.tensor(pose),
    )
