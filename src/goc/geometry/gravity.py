"""Finds up and the floor of a scene from level surfaces and from the orientation of the cameras."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int64

from goc.geometry.planes import Plane, along, find_plane, plane_inliers, refine_plane

LEVEL = np.cos(np.radians(12.0))
"""Least cosine between up and the normal of a horizontal surface."""
TILT = np.cos(np.radians(40.0))
"""Least cosine between the normal of a level plane and the up of the cameras."""
_WIDE_TILT = np.cos(np.radians(70.0))
"""Used instead of `TILT` if no plane is found: cameras that look down at a table from one side tilt this far."""
MAX_BELOW = 0.2
"""Largest share of the points below a floor, as mirrors, glass and stairs cause them."""
UPRIGHT = np.cos(np.radians(3.0))
"""Least cosine between the level plane's normal and world z for world z to be taken as up."""
MIN_SHARE = 0.02
"""Least share of all points that a plane of the room has."""
_ALONG_AXIS = np.cos(np.radians(1.0))
"""Least cosine between the level plane's normal and an axis of the world for the axis to be taken as up."""
_UNDER_FLOOR = 0.05
"""Largest share of the points below the floor; a plane with more below it is a table top."""
_CLEAR_SHARE = 0.05
"""Share of all points from which on a level plane has full confidence."""
_GUESSED = 0.25
"""Confidence of an up that comes from the cameras alone, and of a floor that is only the lowest point."""
_LOWEST = 0.001
"""Quantile of the heights that counts as the lowest point, so that stray points are ignored."""


@dataclass(frozen=True, eq=False)
class Gravity:
    """Up and the floor, with confidences."""

    up: Float64[np.ndarray, "3"]
    """Unit vector, world."""
    floor: float
    """Height of the floor along up, up · x, scene units."""
    up_confidence: float
    floor_confidence: float
    """Both from 0 to 1, see `find_gravity`."""
    is_level: bool
    """True if up comes from a plane of the scene or from the caller, False if from the cameras alone."""

    @property
    def confidence(self) -> float:
        """Product of both confidences, 0 to 1."""
        return self.up_confidence * self.floor_confidence


def find_gravity(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    voxel: float,
    poses: Float[np.ndarray, "n 4 4"],
    rng: np.random.Generator,
    up: Float64[np.ndarray, "3"] | None = None,
) -> Gravity:
    """Up and floor of a scene that cameras saw from within.

    Up is the normal of the largest plane within 40° of the cameras' own up (`level_plane`), or else within 70°, for
    cameras that look down on a table. If an axis of the world is within 1° of that normal, the axis is up. Without such
    a plane it is the cameras' own up (`camera_up`). The floor is the lowest level layer with nearly all cameras above
    it and almost no points below; without one it is the lowest point along up.

    Confidences, 0 to 1:

    - up: 1 if given; with a level plane, cos(angle to the cameras' up) · min(1, its share of the points / 5 %); else ¼;
    - floor: share of the cameras above it · min(1, its share of the points / 5 %); ¼ for the lowest point.

    Args:
        points: evenly spread over the surface, about one a voxel.
        normals: unit vectors towards the side that was seen.
        voxel: distance of neighbouring points.
        poses: world from camera (x right, y down, z forward).
        rng: random numbers for the search for planes.
        up: unit vector, if it is known.
    """
    positions, of_cameras = poses[:, :3, 3], camera_up(poses)
    if not np.linalg.norm(of_cameras) > 0.5:  # they look in all directions
        of_cameras = np.array([0.0, 0.0, 1.0])
    sure, is_level = 1.0, True
    if up is None:
        near = level_plane(points, normals, voxel, poses, rng)
        plane = near or level_plane(points, normals, voxel, poses, rng, _WIDE_TILT)
        is_level = plane is not None
        up = of_cameras if plane is None else _along_axis(plane.normal)
        sure = _GUESSED if plane is None else max(0.0, float(up @ of_cameras)) * _weight(plane, points, normals, voxel)
    floor = find_floor(points, normals, voxel, up, positions)
    if floor is not None and _below(floor, points, voxel) <= _UNDER_FLOOR:
        on_floor = plane_inliers(floor, points, normals, 1.5 * voxel)
        offset = float(np.median(along(points[on_floor], up))) if on_floor.any() else floor.offset
        seen = _before(floor, positions) * _weight(floor, points, normals, voxel)
        return Gravity(up, offset, sure, seen, is_level)
    lowest = float(np.quantile(along(points, up), _LOWEST))
    return Gravity(up, lowest, sure, _GUESSED, is_level)


def find_up(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    voxel: float,
    poses: Float[np.ndarray, "n 4 4"],
    rng: np.random.Generator,
) -> tuple[Float64[np.ndarray, "3"], bool]:
    """Return up, and whether a level plane gave it. Up is world z if the plane's normal is within 3° of that."""
    plane = level_plane(points, normals, voxel, poses, rng)
    if plane is None:
        return camera_up(poses), False
    return (np.array([0.0, 0.0, 1.0]) if plane.normal[2] > UPRIGHT else plane.normal), True


def level_plane(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    voxel: float,
    poses: Float[np.ndarray, "n 4 4"],
    rng: np.random.Generator,
    tilt: float = TILT,
) -> Plane | None:
    """Find the largest plane near the cameras' up with nearly all cameras above it; None if there is none.

    Photographers hold cameras level, so the largest plane near their own up is horizontal: a floor or a table. `tilt`
    is the cosine of the largest angle between its normal and the cameras' up.
    """
    guess, positions = camera_up(poses), poses[:, :3, 3]
    tolerance = 1.5 * voxel
    left = along(normals, guess) > tilt
    best: Plane | None = None
    best_count = MIN_SHARE * len(points)
    for _ in range(4):
        rows = np.flatnonzero(left)
        plane = find_plane(points[rows], normals[rows], tolerance, rng)
        if plane is None:
            break
        inliers = plane_inliers(plane, points, normals, tolerance)
        left &= ~inliers
        if inliers.sum() > best_count and _before(plane, positions) > 0.9:
            best, best_count = plane, inliers.sum()
    return best


def camera_up(poses: Float[np.ndarray, "n 4 4"]) -> Float64[np.ndarray, "3"]:
    """Return the upward direction most nearly perpendicular to the cameras' x axes; if ambiguous, their mean up.

    Args:
        poses: world from camera (x right, y down, z forward).
    """
    mean = -poses[:, :3, 1].mean(0)
    mean /= max(np.linalg.norm(mean), 1e-9)
    values, axes = np.linalg.eigh(poses[:, :3, 0].T @ poses[:, :3, 0] / len(poses))
    across = axes[:, 0] if axes[:, 0] @ mean >= 0 else -axes[:, 0]
    clear = values[1] > 0.05 and values[0] < 0.2 * values[1]
    return across if clear and across @ mean > 0.3 else mean


def find_floor(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    voxel: float,
    up: Float64[np.ndarray, "3"],
    positions: Float[np.ndarray, "n 3"],
) -> Plane | None:
    """Find the lowest horizontal layer with a fifth of the largest one's points and nearly all cameras above it."""
    heights = along(points, up)[along(normals, up) > LEVEL]
    if not len(heights):
        return None
    layer = 2.0 * voxel
    counts, edges = layers(heights, layer)
    enough = np.flatnonzero((counts >= 0.2 * counts.max()) & (counts >= 0.5 * MIN_SHARE * len(points)))
    if not len(enough):
        return None
    first = enough[0]
    while first + 1 < len(counts) and counts[first + 1] > counts[first]:
        first += 1
    plane = Plane(up, float(edges[first] + layer))
    plane = refine_plane(plane, points, normals, layer)
    return plane if _before(plane, positions) > 0.9 and _below(plane, points, voxel) < MAX_BELOW else None


def layers(heights: Float[np.ndarray, "p"], layer: float) -> tuple[Int64[np.ndarray, "b"], Float64[np.ndarray, "b"]]:
    """Return the number of points in every window two bins high, and the lower edges of the windows."""
    edges = np.arange(heights.min() - layer, heights.max() + 2 * layer, layer)
    counts, edges = np.histogram(heights, edges)
    return counts[:-1] + counts[1:], edges[:-2]


def _before(plane: Plane, positions: Float[np.ndarray, "n 3"]) -> float:
    """Share of the cameras in front of a plane."""
    return float((plane.distance(positions) > 0).mean())


def _below(plane: Plane, points: Float[np.ndarray, "p 3"], voxel: float) -> float:
    """Share of the points that lie clearly behind a plane."""
    return float((plane.distance(points) < -4.0 * voxel).mean())


def _weight(plane: Plane, points: Float[np.ndarray, "p 3"], normals: Float[np.ndarray, "p 3"], voxel: float) -> float:
    """Confidence in a plane from its share of all points, 0 to 1."""
    return min(1.0, float(plane_inliers(plane, points, normals, 1.5 * voxel).mean()) / _CLEAR_SHARE)


def _along_axis(direction: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3"]:
    """Return the axis of the world within 1° of the direction, or the direction itself if there is none."""
    axis = int(np.abs(direction).argmax())
    near = abs(direction[axis]) > _ALONG_AXIS
    return np.sign(direction[axis]) * np.eye(3)[axis] if near else direction
