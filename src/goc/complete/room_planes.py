"""The room without its objects, and the walls that nothing reaches behind."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from scipy.spatial import cKDTree

from goc.geometry.planes import Plane, find_plane, plane_inliers
from goc.scene import HalfSpace, Mesh

_APART = 0.01
"""Scene surface this near to an object's measured surface is the object's, metres."""
_MOST = 60_000
"""Samples of the room in which walls are sought."""
_UPRIGHT = np.sin(np.radians(10.0))
"""Greatest |cosine| between up and a wall's normal."""
_WALLS = 10
_THICK = 0.015
"""Distance from a plane within which surface is a wall's, metres."""
_LEAST_AREA = 0.3
"""Least seen area of a wall, square metres: cabinets that are no objects have faces too."""
_BESIDE = 0.25
"""A wall is seen within this of an object's outline on it, metres."""
_LEAST_LOCAL = 0.03
"""Area of it that is, square metres."""
_STRAY = 0.005
"""Share of an object's measured points that may lie behind a wall."""
_FAR = 0.6
"""Walls further away than this do not matter to an object, metres."""


@dataclass(frozen=True, eq=False)
class RoomSurface:
    """Faces of a mesh as oriented points in the level frame: metres, z up."""

    points: Float64[np.ndarray, "t 3"]
    """Centroids."""
    normals: Float64[np.ndarray, "t 3"]
    """Unit, towards the cameras."""
    areas: Float64[np.ndarray, "t"]

    @staticmethod
    def of(mesh: Mesh, level: Float64[np.ndarray, "4 4"]) -> "RoomSurface":
        """Faces of a mesh that have an area.

        Args:
            mesh: world.
            level: level frame from world, a similarity.
        """
        a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
        normals = np.cross(b - a, c - a) @ level[:3, :3].T
        scale = float(np.cbrt(np.linalg.det(level[:3, :3])))
        lengths = np.linalg.norm(normals, axis=1)
        kept = lengths > 0
        centres = ((a + b + c) / 3)[kept] @ level[:3, :3].T + level[:3, 3]
        return RoomSurface(centres, normals[kept] / lengths[kept, None], lengths[kept] * scale / 2)


def room_surface(mesh: Mesh, objects: Float32[np.ndarray, "v 3"], level: Float64[np.ndarray, "4 4"]) -> RoomSurface:
    """The part of a scene's surface that is no object's: further than a centimetre from all that was measured of them.

    Args:
        mesh: the whole scene, world.
        objects: measured vertices of all objects, world.
        level: level frame from world.
    """
    surface = RoomSurface.of(mesh, level)
    tree = cKDTree(objects.astype(np.float64) @ level[:3, :3].T + level[:3, 3])
    own = tree.query(surface.points, distance_upper_bound=_APART)[0] > _APART
    return RoomSurface(surface.points[own], surface.normals[own], surface.areas[own])


def wall_planes(room: RoomSurface) -> list[Plane]:
    """The largest upright planes of a room, in the level frame; their normals point into the room."""
    upright = np.flatnonzero(np.abs(room.normals[:, 2]) <= _UPRIGHT)
    rng = np.random.default_rng(0)
    if len(upright) > _MOST:
        upright = np.sort(rng.choice(upright, _MOST, replace=False))
    points, normals, areas = room.points[upright], room.normals[upright], room.areas[upright]
    each = float(room.areas[np.abs(room.normals[:, 2]) <= _UPRIGHT].sum()) / max(float(areas.sum()), 1e-12)
    planes: list[Plane] = []
    for _ in range(_WALLS):
        found = find_plane(points, normals, _THICK, rng)
        if found is None:
            break
        plane = _upright(found, points, normals)
        on = plane_inliers(plane, points, normals, _THICK)
        if each * areas[on].sum() < _LEAST_AREA:
            break
        planes.append(plane)
        points, normals, areas = points[~on], normals[~on], areas[~on]
    return planes


def walls_of(points: Float64[np.ndarray, "v 3"], planes: Sequence[Plane], room: RoomSurface) -> list[HalfSpace]:
    """The walls that an object is in front of and that are seen beside or above it, in the level frame.

    Args:
        points: measured of the object, level frame.
        planes: walls.
        room: where walls were seen: far from all that was seen of one, its plane bounds nothing.
    """
    found: list[HalfSpace] = []
    for plane in planes:
        ahead = plane.distance(points)
        if float((ahead < -_THICK).mean()) > _STRAY or float(np.quantile(ahead, _STRAY)) > _FAR:
            continue
        on = plane_inliers(plane, room.points, room.normals, _THICK)
        across = np.stack([np.cross(plane.normal, [0.0, 0, 1]), [0.0, 0, 1]], axis=1)
        outline, wall = points @ across, room.points[on] @ across
        low, high = outline.min(axis=0) - _BESIDE, outline.max(axis=0) + _BESIDE
        near = ((wall >= low) & (wall <= high)).all(axis=1)
        if float(room.areas[on][near].sum()) >= _LEAST_LOCAL and _reaches_behind(outline[:, 0], wall[near, 0]):
            offset = float(np.median(room.points[on][near] @ plane.normal))
            found.append(HalfSpace(normal=plane.normal.astype(np.float64), offset=offset))
    return found


def _reaches_behind(outline: Float64[np.ndarray, "v"], wall: Float64[np.ndarray, "w"]) -> bool:
    """The wall is seen on both sides of an object's middle: the plane goes on behind it and does not end before."""
    middle = float(outline.min() + outline.max()) / 2
    return bool((wall < middle).any() and (wall > middle).any())


def _upright(plane: Plane, points: Float64[np.ndarray, "p 3"], normals: Float64[np.ndarray, "p 3"]) -> Plane:
    """The same plane without its lean, through the median of its points."""
    flat = plane.normal * np.array([1.0, 1, 0])
    flat = flat / np.linalg.norm(flat)
    on = plane_inliers(plane, points, normals, _THICK)
    return Plane(flat, float(np.median(points[on] @ flat)))
