"""Camera poses as of a person filming a room: round it at head height, and close-ups of each object."""

import numpy as np
import torch
from jaxtyping import Bool, Float

from goc.geometry.raycast import TriangleScene
from goc.scene import Camera
from goc.synth.model import Model
from goc.synth.room import FurnishedRoom

CLEARANCE = 0.32
"""Metres that a camera keeps from every surface."""
_DISTANCE_LIMITS = (0.55, 1.9)
"""Least and greatest distance, metres, of a close-up from the middle of its object."""

Rng = np.random.Generator
Pose = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]
"""Where a camera is and what point it looks at."""


def camera_path(
    room: FurnishedRoom, scene: TriangleScene, views: int, width: int, height: int, seed: int
) -> tuple[Camera, ...]:
    """Posed cameras that together see the whole room and every object from several sides.

    Half of the views go round the room near its walls and look across it; a fifth stand near its middle and look
    outwards; the others look at one object each, from close by. None is nearer than CLEARANCE to any surface.

    Args:
        room: what to look at.
        scene: all of its surfaces.
        views: how many cameras.
        width: of the images, pixels; the field of view is 68° across.
        height: of the images, pixels.
        seed: of the shake of the hand and of the choices.
    """
    rng = np.random.default_rng([seed, 1])
    outward, close = round(0.2 * views), round(0.35 * views)
    poses = _round_trip(room, scene, views - outward - close, rng)
    poses += _look_outward(room, scene, outward, rng)
    poses += _close_looks(room, scene, close, rng)
    focal = width / (2 * np.tan(np.radians(34.0)))
    return tuple(_camera(eye, target, focal, (width, height), rng) for eye, target in poses)


def _camera(eye: np.ndarray, target: np.ndarray, focal: float, size: tuple[int, int], rng: Rng) -> Camera:
    """A camera that looks at a point, its horizon a degree or two off."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    roll = np.radians(rng.normal(0, 1.2))
    pose = np.eye(4)
    pose[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
    pose[:3, 1] = np.cos(roll) * down - np.sin(roll) * right
    pose[:3, 2] = forward
    pose[:3, 3] = eye
    return Camera(
        focal_px=torch.tensor([focal, focal], dtype=torch.float32),
        centre_px=torch.tensor([size[0] / 2, size[1] / 2], dtype=torch.float32),
        width=size[0],
        height=size[1],
        world_from_cam=torch.tensor(pose, dtype=torch.float32),
    )


def _round_trip(room: FurnishedRoom, scene: TriangleScene, count: int, rng: Rng) -> list[Pose]:
    """One and a half rounds on an oval near the walls, looking at the middle of the room, at varying height."""
    poses = []
    reach = room.size.half[:2] - 0.5
    phase = float(rng.uniform(0, 2 * np.pi))
    for i in range(count):
        turn = phase + 3 * np.pi * i / count
        for shrink in np.linspace(1.0, 0.3, 29):
            # A squarish oval: it comes nearer to the corners than an ellipse does.
            x, y = (np.sign(w) * abs(w) ** 0.7 for w in (np.cos(turn), np.sin(turn)))
            level = 1.5 + 0.17 * np.sin(2.7 * turn) + float(rng.normal(0, 0.02))
            eye = np.array([shrink * reach[0] * x, shrink * reach[1] * y, level])
            if _clear(scene, eye[None])[0]:
                break
        wander = np.array([0.7 * np.cos(1.7 * turn), 0.6 * np.sin(2.3 * turn), 0.0])
        poses.append((eye, wander + np.array([0.0, 0.0, 0.62 + 0.2 * np.sin(3.1 * turn)])))
    return poses


def _look_outward(room: FurnishedRoom, scene: TriangleScene, count: int, rng: Rng) -> list[Pose]:
    """Poses near the middle of the room that look outwards in all directions."""
    poses = []
    for i in range(count):
        turn = 2 * np.pi * i / count
        direction = np.array([np.cos(turn), np.sin(turn), 0.0])
        candidates = -direction * rng.uniform(0.2, 1.3, (60, 1)) + rng.uniform(-0.5, 0.5, (60, 3)) * np.array([1, 1, 0])
        candidates[:, 2] = rng.uniform(1.25, 1.6, 60)
        free = candidates[_clear(scene, candidates)]
        eye = free[0] if len(free) else np.array([0.0, 0.0, 1.6])
        aim = 2.2 * direction + np.array([0, 0, (0.55, 1.0, 1.5)[i % 3]])
        poses.append((eye, aim))
    return poses


def _close_looks(room: FurnishedRoom, scene: TriangleScene, count: int, rng: Rng) -> list[Pose]:
    """Close-ups of each object in turn: from where most of it is visible, and from a side not yet seen."""
    poses: list[Pose] = []
    looked: dict[int, list[np.ndarray]] = {key: [] for key in room.objects}
    order = sorted(room.objects, key=lambda key: _extent(room.objects[key]))  # small things need it most
    for i in range(count):
        key = order[i % len(order)]
        low, high = room.objects[key].bounds
        middle = (low + high) / 2
        eyes = _candidates(middle, _extent(room.objects[key]), rng)
        inside = (np.abs(eyes[:, :2]) < room.size.half[:2] - CLEARANCE).all(-1) & (eyes[:, 2] < room.size.height - 0.4)
        eyes = eyes[inside]
        eyes = eyes[_clear(scene, eyes)]
        if len(eyes) == 0:
            continue
        side = (eyes - middle) / np.linalg.norm(eyes - middle, axis=-1, keepdims=True)
        known = max(len(looked[key]), 1)
        familiar = np.max([side @ other for other in looked[key]], axis=0) if looked[key] else np.zeros(len(eyes))
        best = (_seen_share(scene, eyes, low, high) - 0.4 * familiar / known**0.5).argmax()
        looked[key].append(side[best])
        poses.append((eyes[best], middle + rng.normal(0, 0.03, 3)))
    return poses


def _extent(model: Model) -> float:
    low, high = model.bounds
    return float(np.linalg.norm(high - low))


def _candidates(middle: np.ndarray, extent: float, rng: Rng) -> Float[np.ndarray, "k 3"]:
    """Places round a thing from which it fills a good part of the image, from level to steeply above."""
    distance = np.clip(extent * rng.uniform(0.9, 1.6, 120), *_DISTANCE_LIMITS)
    azimuth, elevation = rng.uniform(-np.pi, np.pi, 120), np.radians(rng.uniform(12, 60, 120))
    direction = np.stack(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)], -1
    )
    return middle + distance[:, None] * direction


def _clear(scene: TriangleScene, eyes: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, "k"]:
    """Whether nothing lies within CLEARANCE of an eye, in 100 directions, and the eye is in the open."""
    index = np.arange(100) + 0.5
    height, turn = 1 - index / 50, index * np.pi * (1 + 5**0.5)
    ring = np.sqrt(1 - height**2)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], -1)
    origins = np.repeat(eyes, len(directions), 0)
    hits = scene.closest_hit(origins, np.tile(directions, (len(eyes), 1)))
    return (hits.t.reshape(len(eyes), -1) > CLEARANCE).all(-1) & hits.found.reshape(len(eyes), -1).all(-1)


def _seen_share(scene: TriangleScene, eyes: np.ndarray, low: np.ndarray, high: np.ndarray) -> Float[np.ndarray, "k"]:
    """Share of 27 points inside the box of a thing that lie in open view or not far behind a surface."""
    steps = np.stack(np.meshgrid(*[[-0.4, 0.0, 0.4]] * 3, indexing="ij"), -1).reshape(-1, 3)
    points = (low + high) / 2 + steps * (high - low)
    origins = np.repeat(eyes, len(points), 0)
    path = np.tile(points, (len(eyes), 1)) - origins
    lengths = np.linalg.norm(path, axis=-1)
    slack = np.linalg.norm(high - low) * 0.35
    open_view = ~scene.occluded(origins, path / lengths[:, None], np.maximum(lengths - slack, 0.05))
    return open_view.reshape(len(eyes), -1).mean(-1)
