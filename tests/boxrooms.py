"""Rooms of axis-aligned boxes on a floor before a wall, with exact depth and ids: closed form by slabs."""

from dataclasses import dataclass

import numpy as np
import torch

from cameras import capture_of, grey, looking_at, pinhole
from goc.scene import ROOM, Capture, Frame

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
FLOOR: Box = ((-2.0, -2.0, -0.2), (2.0, 2.0, 0.0))
WALL: Box = ((-2.0, 2.0, -0.2), (2.0, 2.2, 2.4))
SHELL = {ROOM: [FLOOR, WALL]}


def table(x: float, y: float, width: float = 1.2, depth: float = 0.8, height: float = 0.72) -> list[Box]:
    """A board on four legs, its middle at (x, y)."""
    board = ((x - width / 2, y - depth / 2, height - 0.04), (x + width / 2, y + depth / 2, height))
    legs = [
        ((a - 0.035, b - 0.035, 0.0), (a + 0.035, b + 0.035, height - 0.04))
        for a in (x - width / 2 + 0.06, x + width / 2 - 0.06)
        for b in (y - depth / 2 + 0.06, y + depth / 2 - 0.06)
    ]
    return [board, *legs]


def cube(x: float, y: float, z: float, side: float) -> list[Box]:
    """A cube that stands at height z."""
    return [((x - side / 2, y - side / 2, z), (x + side / 2, y + side / 2, z + side))]


@dataclass(frozen=True)
class Pose:
    """How the made capture differs from the room: target = scale · rotation · source."""

    rotation: np.ndarray
    scale: float = 1.0


UPRIGHT = Pose(np.eye(3))


def orbit(count: int = 14) -> list[np.ndarray]:
    """World from camera (OpenCV axes) on two arcs before the wall, looking at the middle of the room."""
    made = []
    for index, angle in enumerate(np.linspace(-2.8, -0.35, count)):
        far, height = ((2.6, 1.8), (1.7, 1.2))[index % 2]
        position = np.array([far * np.cos(angle), 0.4 + far * np.sin(angle), height])
        made.append(looking_at(position, (0.0, 0.7, 0.35)))
    return made


def shoot(
    boxes: dict[int, list[Box]], pose: np.ndarray, focal: float, width: int, height: int
) -> tuple[np.ndarray, np.ndarray]:
    """Depth (z, NaN = nothing) and ids of one view."""
    x, y = (np.arange(width) + 0.5 - width / 2) / focal, (np.arange(height) + 0.5 - height / 2) / focal
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], np.ones((height, width))), -1) @ pose[:3, :3].T
    depth, ids = np.full((height, width), np.inf), np.full((height, width), -1)
    for number, solids in boxes.items():
        for low, high in solids:
            with np.errstate(divide="ignore", invalid="ignore"):
                a, b = (np.array(low) - pose[:3, 3]) / rays, (np.array(high) - pose[:3, 3]) / rays
            enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
            nearer = (enter < leave) & (enter > 0) & (enter < depth)
            depth[nearer], ids[nearer] = enter[nearer], number
    return np.where(np.isfinite(depth), depth, np.nan), ids


def box_room(
    boxes: dict[int, list[Box]],
    poses: list[np.ndarray] | None = None,
    moved: Pose = UPRIGHT,
    noise: float = 0.0,
    size: tuple[int, int] = (160, 120),
) -> Capture:
    """A capture of the boxes and the shell, its true ids in `ids`; `noise` is in the units of the room."""
    width, height = size
    focal = 0.85 * width
    frames = []
    for index, pose in enumerate(poses or orbit()):
        depth, ids = shoot({**SHELL, **boxes}, pose, focal, width, height)
        depth = depth + noise * np.random.default_rng(index).standard_normal(depth.shape)
        turned = np.eye(4)
        turned[:3, :3] = moved.rotation @ pose[:3, :3]
        turned[:3, 3] = moved.scale * moved.rotation @ pose[:3, 3]
        camera = pinhole(focal, size, pose=turned)
        z = torch.tensor(moved.scale * depth, dtype=torch.float32)
        frames.append(Frame(camera=camera, image=grey(camera, 0), depth=z, ids=torch.tensor(ids, dtype=torch.int16)))
    return capture_of(frames, units_per_metre=moved.scale)
