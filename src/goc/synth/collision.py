"""Tests by their true surfaces whether objects overlap, and how far one can drop until it touches another."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from goc.geometry.raycast import TriangleScene
from goc.synth.model import Model
from goc.synth.vectors import length

_TOUCH = 1e-3
"""Metres by which the upper of two objects is lifted before the test, so that contact is no overlap."""
_INSIDE = np.array([[0.0123, 0.0217, 1.0], [1.0, 0.0171, 0.0113], [0.0191, -1.0, 0.0137]])
"""Askew directions, so that no ray runs along a surface."""


@dataclass(frozen=True, eq=False)
class CollisionMesh:
    """An object's surface in the world, ready for tests."""

    scene: TriangleScene

    @property
    def bounds(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Lowest and highest corner."""
        return self.scene.vertices.min(0).astype(float), self.scene.vertices.max(0).astype(float)


def collision_mesh(model: Model) -> CollisionMesh:
    """All parts as one surface."""
    starts = np.cumsum([0] + [len(item.mesh.vertices) for item in model.parts])
    faces = [item.mesh.faces + start for item, start in zip(model.parts, starts, strict=False)]
    vertices = np.concatenate([item.mesh.vertices for item in model.parts]).astype(np.float32)
    return CollisionMesh(TriangleScene(vertices, np.concatenate(faces).astype(np.int32)))


def interpenetrate(upper: CollisionMesh, lower: CollisionMesh) -> bool:
    """Whether two things share space, where the upper one may stand on the lower one.

    Two surfaces cross if and only if an edge of one pierces the other; if none does, one thing could still lie wholly
    inside the other, which a vertex of it tells. The upper one is lifted by a millimetre first: contact is no overlap.
    """
    lift = np.array([0.0, 0.0, _TOUCH])
    low, high = (corner + lift for corner in upper.bounds)
    other_low, other_high = lower.bounds
    if (low > other_high).any() or (other_low > high).any():
        return False
    starts, paths = _edges(upper.scene)
    other_starts, other_paths = _edges(lower.scene)
    if _pierces(lower.scene, starts + lift, paths) or _pierces(upper.scene, other_starts - lift, other_paths):
        return True
    inside = _within(upper.scene.vertices[:1].astype(float) + lift, lower.scene)
    return bool((inside | _within(lower.scene.vertices[:1].astype(float) - lift, upper.scene)).any())


def _edges(scene: TriangleScene) -> tuple[Float[np.ndarray, "e 3"], Float[np.ndarray, "e 3"]]:
    """Starts of all edges, and the vectors along them; those of no length are left out."""
    pairs = np.unique(np.sort(scene.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1), axis=0)
    starts = scene.vertices[pairs[:, 0]].astype(np.float64)
    paths = scene.vertices[pairs[:, 1]] - starts
    long = length(paths) > 1e-9
    return starts[long], paths[long]


def _pierces(scene: TriangleScene, starts: Float[np.ndarray, "e 3"], paths: Float[np.ndarray, "e 3"]) -> bool:
    return bool(scene.occluded(starts, paths, 1.0).any())


def _within(points: Float[np.ndarray, "n 3"], scene: TriangleScene) -> Bool[np.ndarray, "n"]:
    """Whether points lie inside a closed surface, by two votes of three rays: the first hit shows its back."""
    votes = np.zeros(len(points), int)
    for direction in _INSIDE:
        rays = np.broadcast_to(direction, points.shape)
        hits = scene.closest_hit(points, rays)
        a, b, c = (scene.vertices[scene.faces[hits.triangle, i]].astype(np.float64) for i in range(3))
        votes += hits.found & (np.einsum("ij,ij->i", np.cross(b - a, c - a), rays) > 0)
    return votes >= 2


def height_above(upper: CollisionMesh, lower: CollisionMesh, reach: float = 0.03) -> float:
    """How far the upper thing can sink until it touches the lower one; infinity where it would pass beside it.

    Vertical rays from the vertices of each one's lowest (highest) parts to the other's surface: exact where a vertex
    meets a face. A negative height means that it has to rise.

    Args:
        upper: stands nearly where it should, its lowest vertices at most `reach` above or below the other's surface.
        lower: what it stands on.
        reach: metres.
    """
    low, high = upper.bounds
    down = np.array([1.3e-6, 1.9e-6, -1.0])
    own = upper.scene.vertices[upper.scene.vertices[:, 2] < low[2] + reach].astype(float)
    from_above = _gaps(lower.scene, own - reach * down, down) - reach
    other = lower.scene.vertices.astype(float)
    near = (other[:, :2] >= low[:2]).all(1) & (other[:, :2] <= high[:2]).all(1) & (np.abs(other[:, 2] - low[2]) < reach)
    from_below = _gaps(upper.scene, other[near] + reach * down, -down) - reach
    return float(min(from_above.min(initial=np.inf), from_below.min(initial=np.inf)))


def _gaps(scene: TriangleScene, starts: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "3"]) -> np.ndarray:
    return scene.closest_hit(starts, np.broadcast_to(direction, starts.shape)).t
