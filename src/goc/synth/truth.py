"""Samples of the true surfaces, in the layout that goc.evaluation scores against."""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32

from goc.geometry.raycast import TriangleScene
from goc.scene import Camera
from goc.synth.collision import collision_mesh
from goc.synth.model import Model, ModelPart
from goc.synth.room import FurnishedRoom
from goc.synth.vectors import dot, length

SKIN_SAMPLES = 30_000
SEEN_SAMPLES = 250_000
_POOL = 450_000
"""Candidates for them, on all surfaces."""
_SKIN_OFFSET = 1e-4
"""Metres above a part's surface at which is tested whether another part covers it."""

Samples = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]
"""Points and unit normals."""


def true_samples(
    room: FurnishedRoom, scene: TriangleScene, cameras: tuple[Camera, ...], seed: int
) -> dict[str, Float32[np.ndarray, "..."]]:
    """Sample the true surfaces that a reconstruction is compared with.

    Returns:
        `p<id>`, `n<id>`: 30,000 area-uniform points of each object's outer skin and their normals; where parts of an
        object touch or overlap, their covered surface is left out. `seen`: up to 250,000 area-uniform points of
        everything that some camera saw, rows x y z nx ny nz id.
    """
    rng = np.random.default_rng([seed, 2])
    arrays: dict[str, np.ndarray] = {}
    density = _POOL / (_area(room.shell.parts) + sum(_area(model.parts) for model in room.objects.values()))
    pool = [_with_id(_sampled(room.shell.parts, round(density * _area(room.shell.parts)), rng), 0)]
    for key, model in room.objects.items():
        skin, share = _skin(model, SKIN_SAMPLES, rng)
        arrays[f"p{key}"], arrays[f"n{key}"] = (values.astype(np.float32) for values in skin)
        wanted = round(density * share * _area(model.parts))
        pool.append(_with_id(_skin(model, wanted, rng)[0], key))
    rows = rng.permutation(np.concatenate(pool))
    points, normals = np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:6])
    arrays["seen"] = rows[_seen(points, normals, scene, cameras)][:SEEN_SAMPLES].astype(np.float32)
    return arrays


def _with_id(samples: Samples, key: int) -> Float[np.ndarray, "n 7"]:
    return np.concatenate([*samples, np.full((len(samples[0]), 1), float(key))], -1)


def _area(parts: tuple[ModelPart, ...]) -> float:
    return float(sum(_face_areas(item).sum() for item in parts))


def _face_areas(item: ModelPart) -> Float[np.ndarray, "t"]:
    a, b, c = (item.mesh.vertices[item.mesh.faces[:, i]] for i in range(3))
    return 0.5 * length(np.cross(b - a, c - a))


def _sampled(parts: tuple[ModelPart, ...], count: int, rng: np.random.Generator) -> Samples:
    """Area-uniform points on all parts, covered ones included."""
    corners = np.concatenate([item.mesh.vertices[item.mesh.faces] for item in parts])
    areas = np.concatenate([_face_areas(item) for item in parts])
    face = rng.choice(len(areas), count, p=areas / areas.sum())
    first, second = rng.random((2, count, 1))
    root = np.sqrt(first)
    a, b, c = (corners[face, i] for i in range(3))
    points = (1 - root) * a + root * (1 - second) * b + root * second * c
    return points, np.cross(b - a, c - a) / (2 * areas[face])[:, None]


def _skin(model: Model, count: int, rng: np.random.Generator) -> tuple[Samples, float]:
    """That many points of the outer skin, and which share of all surface belongs to it.

    Of built-in things, whose parts are closed, that is what no other part covers; of scanned ones, what can be seen
    from outside.
    """
    scenes = [collision_mesh(replace(model, parts=(item,))).scene for item in model.parts]
    outer = collision_mesh(model).scene if any(item.scanned for item in model.parts) else None
    points, normals = np.zeros((0, 3)), np.zeros((0, 3))
    drawn = 0
    while len(points) < count:
        more, facing = _sampled(model.parts, count, rng)
        drawn += count
        if outer is None:
            open_air = ~_covered(model.parts, scenes, more + _SKIN_OFFSET * facing)
        else:
            open_air = _seen_from_outside(outer, more, facing)
        points, normals = np.concatenate([points, more[open_air]]), np.concatenate([normals, facing[open_air]])
    return (points[:count], normals[:count]), len(points) / drawn


def _seen_from_outside(
    scene: TriangleScene, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, "n"]:
    """Whether some of 64 rays from just above a point (or, of an open sheet, just below it) leaves the thing."""
    reach = 4 * float(np.ptp(scene.vertices, axis=0).max())
    index = np.arange(64) + 0.5
    height, angle = 1 - index / 32, np.pi * (1 + 5**0.5) * index
    ring = np.sqrt(1 - height**2)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], -1)
    seen = np.zeros(len(points), bool)
    # In an order that soon has some in each direction: most points are settled after a few.
    for direction in directions[np.argsort(np.arange(64) * 0.618 % 1)]:
        left = np.flatnonzero(~seen)
        side = np.where(normals[left] @ direction >= 0, 1.0, -1.0)[:, None]
        origins = points[left] + _SKIN_OFFSET * side * normals[left]
        seen[left] = ~scene.occluded(origins, np.broadcast_to(direction, origins.shape), reach)
    return seen


def _covered(
    parts: tuple[ModelPart, ...], scenes: list[TriangleScene], points: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, "n"]:
    """Whether each point lies inside some closed part: then the first surface above it is seen from behind."""
    covered = np.zeros(len(points), bool)
    for item, scene in zip(parts, scenes, strict=True):
        low, high = item.mesh.vertices.min(0), item.mesh.vertices.max(0)
        near = np.flatnonzero(((points >= low) & (points <= high)).all(-1))
        upward = np.broadcast_to(np.array([0.0123, 0.0217, 1.0]), (len(near), 3))  # askew: no ray along an edge
        hits = scene.closest_hit(points[near], upward)
        a, b, c = (scene.vertices[scene.faces[hits.triangle, i]] for i in range(3))
        covered[near] |= hits.found & (dot(np.cross(b - a, c - a), upward) > 0)
    return covered


def _seen(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    scene: TriangleScene,
    cameras: tuple[Camera, ...],
) -> Bool[np.ndarray, "n"]:
    """Whether each point lies inside the image of some camera that it faces, with nothing before it."""
    seen = np.zeros(len(points), bool)
    for camera in cameras:
        left = np.flatnonzero(~seen)
        eye = camera.position.double().numpy()
        path = points[left] - eye
        inside = camera.double().sees(torch.from_numpy(points[left].astype(np.float64))).numpy()
        chosen = np.flatnonzero(inside & (dot(path, normals[left]) < 0))
        origins = np.broadcast_to(eye, (len(chosen), 3))
        # Up to a thousandth before the point itself: parts that touch lie nearer than that to it.
        blocked = scene.occluded(origins, path[chosen], 1 - 1e-3)
        seen[left[chosen[~blocked]]] = True
    return seen
