"""The scene's world, found once: up, floor, and how sure they are."""

import numpy as np
from jaxtyping import Float64

from goc.events import Listener, Warned, ignore
from goc.extract.config import WorldConfig
from goc.geometry.gravity import Gravity, find_gravity
from goc.geometry.surfaces import vertex_normals
from goc.geometry.voxels import cells_of, pack_cells, sum_by_key
from goc.scene import Capture, Mesh, World

_VOXEL_M = 0.03
"""Edge of the cells that the surface is thinned to, metres."""
_FEWEST = 100
"""Cells along the scene's diagonal that there are at least, where the guessed metre is too long."""


def find_world(mesh: Mesh, views: Capture, config: WorldConfig, notify: Listener = ignore) -> World:
    """Up and floor from the scene's surface and the cameras, or as the user said.

    Args:
        mesh: the whole scene, faces counter-clockwise seen from the cameras.
        views: their cameras and units.
        config: what the user knows.
        notify: hears a warning where nothing but the cameras tells up.

    Returns:
        Confidence as `find_gravity` has it; what the user gave counts as sure.
    """
    given = None if config.up is None else np.array(config.up, np.float64) / np.linalg.norm(config.up)
    points, normals, voxel = _thinned(mesh, _VOXEL_M * views.units_per_metre)
    poses = np.stack([camera.world_from_cam.double().numpy() for camera in views.cameras])
    found = find_gravity(points, normals, voxel, poses, np.random.default_rng(0), given)
    if not found.is_level:
        message = "No level surface tells which way is up: guessed from the cameras. Pass --world.up if it is wrong."
        notify(Warned(stage="extract", message=message))
    return World(
        up=found.up,
        floor=found.floor if config.floor is None else config.floor,
        confidence=_confidence(found, config),
        units_per_metre=views.units_per_metre,
        metric=views.metric,
    )


def _confidence(found: Gravity, config: WorldConfig) -> float:
    """Of up alone where the user gave the floor."""
    return round(found.confidence if config.floor is None else found.up_confidence, 3)


def _thinned(mesh: Mesh, voxel: float) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p 3"], float]:
    """Mean place and normal of the vertices in each cell, in the order of the cells, and the cells' edge."""
    normals = vertex_normals(mesh).astype(np.float64)
    faced = np.linalg.norm(normals, axis=1) > 0.5
    vertices, normals = mesh.vertices[faced].astype(np.float64), normals[faced]
    corner = vertices.min(axis=0)
    voxel = min(voxel, float(np.linalg.norm(np.ptp(vertices, axis=0))) / _FEWEST)
    rows = np.concatenate([vertices, normals, np.ones((len(vertices), 1))], axis=1)
    _, sums = sum_by_key(pack_cells(cells_of(vertices - corner, voxel)), rows)
    length = np.linalg.norm(sums[:, 3:6], axis=1, keepdims=True)
    kept = length[:, 0] > 0.5 * sums[:, 6]  # cells with a fold in them face nowhere
    return (sums[:, :3] / sums[:, 6:])[kept], (sums[:, 3:6] / np.maximum(length, 1e-12))[kept], voxel
