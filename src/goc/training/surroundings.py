"""Occluders around a training shape: floor, walls, a table under it, boxes beside it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32

from goc.geometry.raycast import TriangleScene
from goc.training.placement import PlacedShape

Random = np.random.Generator


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """The scene around a shape, and where cameras may stand in it."""

    scene: TriangleScene | None
    """None: the object floats in nothing."""
    walls: Float64[np.ndarray, "k 4"]
    """Planes n·x = d with n pointing into the room."""
    lowest: float
    """No camera is below this height."""
    contacts: Float64[np.ndarray, "m 4"]
    """Planes n·x = d behind which no part of the object can be: the walls, and what it stands on."""

    def allows(self, position: Float64[np.ndarray, "3"]) -> bool:
        """Whether a camera can be there."""
        free = self.walls[:, :3] @ position > self.walls[:, 3] + 0.05
        return bool(free.all() and position[2] > self.lowest)


def no_surroundings() -> Surroundings:
    """No occluders: a shape alone, visible from everywhere."""
    return Surroundings(scene=None, walls=np.zeros((0, 4)), lowest=-np.inf, contacts=np.zeros((0, 4)))


def random_surroundings(placed: PlacedShape, yaw: float, random: Random, backed: bool = False) -> Surroundings:
    """A room in which the object stands on the floor or on a table, near no, one or two walls, among other boxes.

    `backed`: at least one wall is close behind it.
    """
    low, high = placed.box()
    middle, reach = (low + high) / 2, float((high - low).max())
    bodies: list[tuple[np.ndarray, np.ndarray]] = []
    support = random.random()
    lowest = 0.05
    if support < 0.6:  # on the floor
        floor = stand = -random.uniform(0, 0.01)
    else:  # on a table, or hung up: the floor is further down
        floor = -random.uniform(0.3, 1.5)
        stand, lowest = floor, floor + 0.05
        if support < 0.9:
            top = np.array([*(high - low)[:2] * random.uniform(0.8, 2.5, 2), 0.05])
            shift = random.uniform(-0.3, 0.3, 2) * top[:2] * 0.5
            stand = -random.uniform(0, 0.01)
            bodies.append(_box(top, np.array([*middle[:2] + shift, stand - 0.025]), yaw))
    walls = _walls(low, high, yaw, random, backed)
    for _ in range(random.integers(0, 5)):
        bodies.append(_neighbour(middle, reach, floor, random))
    if random.random() < 0.15:  # something stands on the object
        sides = random.uniform(0.1, 0.4, 3) * reach
        spot = random.uniform(low, high) * [1, 1, 0] + [0, 0, high[2] + sides[2] / 2]
        bodies.append(_box(sides, spot, random.uniform(0, np.pi)))
    bodies += _shell(middle, reach * random.uniform(3, 6), floor, walls)
    contacts = np.concatenate([walls, [[0.0, 0.0, 1.0, stand]]])
    return Surroundings(scene=_joined(bodies), walls=walls, lowest=lowest, contacts=contacts)


def _walls(low: np.ndarray, high: np.ndarray, yaw: float, random: Random, backed: bool) -> Float64[np.ndarray, "k 4"]:
    """Up to two walls beside the object: behind it (its +y) more often than elsewhere, aligned with it as a rule."""
    count = random.choice([0, 1, 2], p=[0.0, 0.5, 0.5] if backed else [0.4, 0.4, 0.2])
    angle = yaw if random.random() < 0.8 else random.uniform(0, 2 * np.pi)
    behind = 0.85 if backed else 0.55
    first = random.choice([1, 0, 2, 3], p=[behind, *[(1 - behind) / 3] * 3])  # quarter turns from +x
    planes = []
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1).reshape(-1, 3)
    for turn in (first, first + random.choice([-1, 1]))[:count]:
        outwards = np.array([np.cos(angle + turn * np.pi / 2), np.sin(angle + turn * np.pi / 2), 0.0])
        near, far = random.uniform(0, 0.03), random.uniform(0.03, 0.4)
        gap = near if backed else random.choice([near, far])
        planes.append([*-outwards, -(corners @ outwards).max() - gap])
    return np.array(planes).reshape(-1, 4)


def _neighbour(middle: np.ndarray, reach: float, floor: float, random: Random) -> tuple[np.ndarray, np.ndarray]:
    """A box near the object, standing on the floor or hanging somewhere."""
    sides = random.uniform(0.1, 0.9, 3) * reach
    angle = random.uniform(0, 2 * np.pi)
    away = 0.5 * reach + 0.6 * float(np.linalg.norm(sides[:2])) + random.uniform(0, 0.6) * reach
    spot = np.array([middle[0] + away * np.cos(angle), middle[1] + away * np.sin(angle), floor + sides[2] / 2])
    if random.random() < 0.4:
        spot[2] = middle[2] + random.uniform(-0.5, 0.8) * reach
    return _box(sides, spot, random.uniform(0, np.pi))


def _shell(
    middle: np.ndarray, half: float, floor: float, walls: Float64[np.ndarray, "k 4"]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Floor, ceiling and far walls, so that every ray ends somewhere; and the near walls."""
    low, high = middle - half, middle + half
    low[2] = floor
    vertices, faces = _box(high - low, (low + high) / 2, 0.0)
    bodies = [(vertices, faces)]
    for nx, ny, _, d in walls:
        along = np.array([-ny, nx, 0.0]) * 2 * half
        foot = np.array([nx, ny, 0.0]) * d + np.array([-ny, nx, 0.0]) * (np.array([-ny, nx, 0]) @ middle)
        up = np.array([0, 0, 2 * half])
        corners = np.stack([foot - along - up, foot + along - up, foot + along + up, foot - along + up])
        bodies.append((corners, np.array([[0, 1, 2], [0, 2, 3]])))
    return bodies


def _box(sides: Float[np.ndarray, "3"], at: Float[np.ndarray, "3"], yaw: float) -> tuple[np.ndarray, np.ndarray]:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * sides / 2
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return signs @ turn.T + at, np.array(faces)


def _joined(bodies: list[tuple[np.ndarray, np.ndarray]]) -> TriangleScene:
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in bodies])
    vertices: Float32[np.ndarray, "v 3"] = np.concatenate([v for v, _ in bodies]).astype(np.float32)
    faces: Int32[np.ndarray, "t 3"] = np.concatenate(
        [f + start for (_, f), start in zip(bodies, starts, strict=False)]
    ).astype(np.int32)
    return TriangleScene(vertices, faces)
