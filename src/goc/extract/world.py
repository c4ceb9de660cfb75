"""Finds the world of a scene: up, floor, and the confidence in both."""

import numpy as np
from jaxtyping import Float64

from goc.events import Listener, Warned, ignore
from goc.extract.config import WorldConfig
from goc.geometry.gravity import Gravity, find_gravity
from goc.geometry.surfaces import vertex_normals
from goc.geometry.voxels import cells_of, pack_cells, sum_by_key
from goc.scene import Capture, Mesh, World

_VOXEL_M = 0.03
"""Edge of the cells to which the surface is thinned, metres."""
_SAME_UP = 0.985  # cosine of 10 degrees
_DOUBTFUL = 0.5
"""Confidence in up below which a user is told."""
_FEWEST = 100
"""Least number of cells along the scene's diagonal, for scenes whose guessed metre is too long."""


def find_world(mesh: Mesh, views: Capture, config: WorldConfig, notify: Listener = ignore) -> World:
    """Find up and floor from the scene's surface and the cameras; values that the user gave are kept.

    Args:
        mesh: the whole scene, faces counter-clockwise seen from the cameras.
        views: cameras and units.
        config: up and floor that the user gave, if any.
        notify: receives a warning if up comes from the cameras alone.

    Returns:
        The world, with the confidence of `find_gravity`; values that the user gave have confidence 1.
    """
    given = None if config.up is None else np.array(config.up, np.float64) / np.linalg.norm(config.up)
    points, normals, voxel = _thinned(mesh, _VOXEL_M * views.units_per_metre)
    poses = np.stack([camera.world_from_cam.double().numpy() for camera in views.cameras])
    found = find_gravity(points, normals, voxel, poses, np.random.default_rng(0), given)
    if given is None and views.up is not None:
        stated = np.array(views.up, np.float64) / np.linalg.norm(views.up)
        if (
            not found.is_level or found.up @ stated < _SAME_UP
        ):  # the format knows the way to a few degrees, planes know it better
            found = find_gravity(points, normals, voxel, poses, np.random.default_rng(0), stated)
    if not found.is_level:
        message = "No level surface tells which way is up: guessed from the cameras. Pass --world.up if it is wrong."
        notify(Warned(stage="extract", message=message))
    elif found.up_confidence < _DOUBTFUL:
        message = (
            f"Up is uncertain (confidence {found.up_confidence:.2f}): the level surface that tells it is small, or the "
            "cameras were held askew. Pass --world.up if the result leans."
        )
        notify(Warned(stage="extract", message=message))
    return World(
        up=found.up,
        floor=found.floor if config.floor is None else config.floor,
        confidence=_confidence(found, config),
        units_per_metre=views.units_per_metre,
        metric=views.metric,
        offset=views.offset,
    )


def _confidence(found: Gravity, config: WorldConfig) -> float:
    """Confidence in up and floor, or in up alone if the user gave the floor."""
    return round(found.confidence if config.floor is None else found.up_confidence, 3)


def _thinned(mesh: Mesh, voxel: float) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p 3"], float]:
    """Mean position and normal of the vertices in each cell, in the order of the cells, and the edge of the cells."""
    normals = vertex_normals(mesh).astype(np.float64)
    faced = np.linalg.norm(normals, axis=1) > 0.5
    vertices, normals = mesh.vertices[faced].astype(np.float64), normals[faced]
    corner = vertices.min(axis=0)
    voxel = min(voxel, float(np.linalg.norm(np.ptp(vertices, axis=0))) / _FEWEST)
    rows = np.concatenate([vertices, normals, np.ones((len(vertices), 1))], axis=1)
    _, sums = sum_by_key(pack_cells(cells_of(vertices - corner, voxel)), rows)
    length = np.linalg.norm(sums[:, 3:6], axis=1, keepdims=True)
    kept = length[:, 0] > 0.5 * sums[:, 6]  # the normals in a cell with a fold cancel out
    return (sums[:, :3] / sums[:, 6:])[kept], (sums[:, 3:6] / np.maximum(length, 1e-12))[kept], voxel
