"""Finds the up direction and the planes of the room: floor, ceiling and walls."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64

from goc.geometry.gravity import LEVEL, MIN_SHARE, find_floor, find_up, layers
from goc.geometry.planes import Plane, along, find_plane, plane_inliers, refine_plane, robust_sigma
from goc.geometry.voxels import parts_of
from goc.priors.segmentation.surface_voxels import SurfaceVoxels
from goc.scene import Camera

CEILING_SHARE = 0.004
"""A ceiling is above all cameras, and less is seen of it."""
MAX_BEHIND = 0.12
"""Voxels seen behind a wall, as a share of the wall's own: more, and it is the front of a thing."""


@dataclass(frozen=True, eq=False)
class RoomPlanes:
    """Up, the planes that bound the room, and the voxels they claim."""

    up: Float[np.ndarray, "3"]
    floor: Plane | None
    ceiling: Plane | None
    walls: tuple[Plane, ...]
    noise: float
    """Standard deviation of the surface about those planes, scene units; half a voxel where there is no plane."""
    mask: Bool[np.ndarray, "v"]


def find_room_planes(
    surface: SurfaceVoxels, cameras: tuple[Camera, ...], units_per_metre: float, rng: np.random.Generator
) -> RoomPlanes:
    """Find up, the planes of the room, and the voxels on them; without any plane, the largest structure is the room."""
    poses = np.stack([camera.world_from_cam.double().numpy() for camera in cameras])
    positions = poses[:, :3, 3]
    up, level = find_up(surface.points, surface.normals, surface.voxel, poses, rng)
    floor = find_floor(surface.points, surface.normals, surface.voxel, up, positions) if level else None
    ceiling = _ceiling(surface, up, positions) if level else None
    walls = _walls(surface, up, positions, units_per_metre, rng)
    planes = [plane for plane in (floor, ceiling, *walls) if plane is not None]
    noises = [
        min(max(robust_sigma(_near(plane, surface)), 0.25 * surface.voxel), 0.03 * units_per_metre) for plane in planes
    ]
    mask = np.zeros(len(surface), bool)
    for plane, noise in zip(planes, noises, strict=True):
        mask |= claimed_by(plane, surface, noise, up, units_per_metre)
    if not planes:
        mask = _largest_part(surface)
    noise = float(np.median(noises)) if noises else 0.5 * surface.voxel
    return RoomPlanes(up, floor, ceiling, walls, noise, mask)


def _largest_part(surface: SurfaceVoxels) -> Bool[np.ndarray, "v"]:
    """The largest connected structure: the room of a capture that shows no plane."""
    parts = parts_of(surface.keys, np.ones(len(surface), bool), 1.8)
    return parts == np.bincount(parts).argmax()


def claimed_by(
    plane: Plane, surface: SurfaceVoxels, noise: float, up: np.ndarray, units_per_metre: float
) -> Bool[np.ndarray, "v"]:
    """Voxels on a plane, within three noises when they face its way and one otherwise, and those seen behind it."""
    distance = plane.distance(surface.points)
    near = max(3.0 * noise, 0.75 * surface.voxel)
    facing = along(surface.normals, plane.normal) > 0.7
    claimed = distance < np.where(facing, near, np.minimum(near, max(noise, 0.4 * surface.voxel)))
    if abs(plane.normal @ up) > 0.5:
        return claimed
    strips = _strips(plane, surface, up, units_per_metre)
    covered = np.unique(strips[claimed & facing & (distance > -near)])
    return claimed & np.isin(strips, np.concatenate([covered - 1, covered, covered + 1]))


def _strips(plane: Plane, surface: SurfaceVoxels, up: np.ndarray, units_per_metre: float) -> Int64[np.ndarray, "v"]:
    """The upright strip of a wall, ten centimetres wide, before or behind which each voxel lies."""
    return np.floor(along(surface.points, np.cross(up, plane.normal)) / (0.1 * units_per_metre)).astype(np.int64)


def _before(plane: Plane, positions: Float[np.ndarray, "n 3"]) -> float:
    """Share of the cameras that stand before a plane."""
    return float((plane.distance(positions) > 0).mean())


def _ceiling(surface: SurfaceVoxels, up: np.ndarray, positions: np.ndarray) -> Plane | None:
    """The highest large downward layer above the cameras."""
    heights = along(surface.points, up)
    level = (along(surface.normals, up) < -LEVEL) & (heights > np.percentile(along(positions, up), 90))
    if level.sum() < CEILING_SHARE * len(surface):
        return None
    layer = 2.0 * surface.voxel
    counts, edges = layers(-heights[level], layer)
    enough = np.flatnonzero((counts >= 0.3 * counts.max()) & (counts >= CEILING_SHARE * len(surface)))
    if not len(enough):
        return None
    plane = Plane(-up, float(edges[enough[0]] + layer))
    return refine_plane(plane, surface.points, surface.normals, layer)


def _walls(
    surface: SurfaceVoxels,
    up: np.ndarray,
    positions: Float[np.ndarray, "n 3"],
    units_per_metre: float,
    rng: np.random.Generator,
) -> tuple[Plane, ...]:
    """Upright planes before which all cameras stand, tall, and with hardly anything seen behind them."""
    tolerance = 1.5 * surface.voxel
    left = np.abs(along(surface.normals, up)) < 0.25
    walls: list[Plane] = []
    for _ in range(16):
        rows = np.flatnonzero(left)
        if len(rows) < MIN_SHARE * len(surface):
            break
        plane = find_plane(surface.points[rows], surface.normals[rows], tolerance, rng)
        if plane is None:
            break
        inliers = plane_inliers(plane, surface.points, surface.normals, tolerance)
        inliers[~left] = False
        if inliers.sum() < MIN_SHARE * len(surface):
            break
        left &= ~inliers
        if _is_wall(plane, surface, inliers, up, positions, units_per_metre):
            walls.append(plane)
    return tuple(walls)


def _is_wall(
    plane: Plane,
    surface: SurfaceVoxels,
    inliers: np.ndarray,
    up: np.ndarray,
    positions: np.ndarray,
    units_per_metre: float,
) -> bool:
    """Tall, cameras before it, and little seen behind the columns it covers."""
    heights = along(surface.points, up)
    low, high = np.percentile(heights, [1, 99])
    mine = np.percentile(heights[inliers], [2, 98])
    if mine[1] - low < 0.5 * (high - low) or mine[1] - mine[0] < 0.25 * (high - low):
        return False
    if _before(plane, positions) < 0.9:
        return False
    strips = _strips(plane, surface, up, units_per_metre)
    behind = plane.distance(surface.points) < -max(4 * surface.voxel, 0.08 * units_per_metre)
    behind &= np.isin(strips, np.unique(strips[inliers]))
    return bool(surface.views[behind].sum() <= MAX_BEHIND * surface.views[inliers].sum())


def _near(plane: Plane, surface: SurfaceVoxels) -> np.ndarray:
    """Distances of the voxels that make up a plane."""
    return plane.distance(surface.points)[plane_inliers(plane, surface.points, surface.normals, 3.0 * surface.voxel)]
