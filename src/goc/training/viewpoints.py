"""Random poses of virtual cameras: few on an arc, as filmed by hand; many, as a room is scanned; or all round."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float64

from goc.scene.camera import Camera
from goc.training.surroundings import Surroundings

Random = np.random.Generator
Regime = Literal["arc", "room", "sphere"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Viewpoint:
    """A virtual pinhole camera with a square image; OpenCV axes, principal point in the middle."""

    focal_px: float
    size: int
    world_from_cam: Float64[np.ndarray, "4 4"]

    def rays(self) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p 3"]]:
        """Origins and directions of all pixels, row by row, world; directions have z = 1 in camera axes."""
        steps = (np.arange(self.size) + 0.5 - self.size / 2) / self.focal_px
        x, y = np.meshgrid(steps, steps)
        local = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
        directions = local @ self.world_from_cam[:3, :3].T
        return np.broadcast_to(self.world_from_cam[:3, 3], directions.shape), directions

    def project(
        self, points: Float64[np.ndarray, "p 3"]
    ) -> tuple[Float64[np.ndarray, "p 2"], Float64[np.ndarray, "p"]]:
        """Pixel coordinates and z of world points."""
        local = (points - self.world_from_cam[:3, 3]) @ self.world_from_cam[:3, :3]
        depth = local[:, 2]
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        return local[:, :2] / safe[:, None] * self.focal_px + self.size / 2, depth

    def camera(self) -> Camera:
        """The same in float64, as fusion takes it."""
        return Camera(
            focal_px=torch.tensor([self.focal_px, self.focal_px], dtype=torch.float64),
            centre_px=torch.tensor([self.size / 2, self.size / 2], dtype=torch.float64),
            width=self.size,
            height=self.size,
            world_from_cam=torch.from_numpy(self.world_from_cam),
        )


def random_viewpoints(
    box: tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]],
    around: Surroundings,
    regime: Regime,
    count: int,
    size: int,
    random: Random,
) -> list[Viewpoint]:
    """Cameras that look at an object, none behind a wall or below the floor; fewer where hardly any fit."""
    low, high = box
    middle, reach = (low + high) / 2, float((high - low).max())
    towards = random.uniform(0, 2 * np.pi)
    span = {"arc": np.deg2rad(random.uniform(60, 180)), "room": np.deg2rad(random.uniform(140, 360))}.get(
        regime, 2 * np.pi
    )
    if len(around.walls):  # people stand in the room
        inward = around.walls[:, :2].sum(0)
        towards = np.arctan2(inward[1], inward[0]) + random.normal(0, 0.5)
    level = random.uniform(5, 50)
    found: list[Viewpoint] = []
    for _ in range(6 * count):
        if len(found) == count:
            break
        angle = towards + random.uniform(-0.5, 0.5) * span
        rise = _elevation(regime, level, random)
        away = reach * random.uniform(1.0, 2.6 if regime != "room" else 3.5)
        position = middle + away * np.array([np.cos(angle) * np.cos(rise), np.sin(angle) * np.cos(rise), np.sin(rise)])
        if around.allows(position):
            aim = middle + random.normal(0, 0.1, 3) * reach
            focal = size * away / reach * random.uniform(0.5, 1.1)
            found.append(Viewpoint(focal_px=float(focal), size=size, world_from_cam=_looking(position, aim)))
    return found


def _elevation(regime: Regime, level: float, random: Random) -> float:
    match regime:
        case "arc":  # one height, held by hand
            return float(np.deg2rad(np.clip(level + random.normal(0, 7), -10, 80)))
        case "room":
            return float(np.deg2rad(random.uniform(-15, 65)))
        case _:
            return float(np.arcsin(random.uniform(-1, 1)))


def _looking(position: Float64[np.ndarray, "3"], aim: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "4 4"]:
    forward = (aim - position) / np.linalg.norm(aim - position)
    right = np.cross(forward, [0, 0, 1.0])
    if np.linalg.norm(right) < 1e-3:
        right = np.array([1.0, 0, 0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], -1)
    pose[:3, 3] = position
    return pose
