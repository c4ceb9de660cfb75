"""Random poses of virtual cameras: few on an arc, as filmed by hand; many, as a room is scanned; or all round."""

from typing import Literal

import numpy as np
import torch
from jaxtyping import Float64

from goc.scene.camera import Camera
from goc.training.surroundings import Surroundings

Random = np.random.Generator
Regime = Literal["arc", "room", "front", "sphere"]


def random_viewpoints(
    box: tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]],
    around: Surroundings,
    regime: Regime,
    count: int,
    size: int,
    random: Random,
) -> list[Camera]:
    """Square float64 cameras on an object: none behind a wall or below the floor; fewer where hardly any fit."""
    low, high = box
    middle, reach = (low + high) / 2, float((high - low).max())
    towards = random.uniform(0, 2 * np.pi)
    least, most = {"arc": (60, 180), "room": (140, 360), "front": (10, 110)}.get(regime, (360, 360))
    span = np.deg2rad(random.uniform(least, most))
    if len(around.walls):  # people stand in the room
        inward = around.walls[:, :2].sum(0)
        towards = np.arctan2(inward[1], inward[0]) + random.normal(0, 0.5)
    level = random.uniform(5, 50)
    found: list[Camera] = []
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
            found.append(_camera(float(focal), size, _looking(position, aim)))
    return found


def _camera(focal: float, size: int, pose: Float64[np.ndarray, "4 4"]) -> Camera:
    return Camera(
        focal_px=torch.full((2,), focal, dtype=torch.float64),
        centre_px=torch.full((2,), size / 2, dtype=torch.float64),
        width=size,
        height=size,
        world_from_cam=torch.from_numpy(pose),
    )


def _elevation(regime: Regime, level: float, random: Random) -> float:
    match regime:
        case "arc" | "front":  # one height, held by hand
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
