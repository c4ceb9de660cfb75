"""Shapes in closed form, seen along axes of the grid: what was measured of them, and the truth at every voxel."""

import numpy as np

from goc.complete import Measured, with_margin
from goc.geometry.isosurface import grid_surface
from goc.scene import Evidence, EvidenceGrid, Mesh

VOXEL = 0.05
COUNT = 36
BAND = 3 * VOXEL


def places(grid):
    axes = (np.arange(n) for n in grid.state.shape)
    return grid.origin + grid.voxel * np.stack(np.meshgrid(*axes, indexing="ij"), -1)


def seen_along(distance_at, ways):
    """What rays along axes tell of a shape; each way is an axis and the sign of the direction that looks at it.

    Returns:
        What was measured, and the true distance in voxels on `with_margin` of its evidence.
    """
    half = VOXEL * (COUNT - 1) / 2
    blank = EvidenceGrid(
        origin=np.full(3, -half),
        voxel=VOXEL,
        state=np.zeros((COUNT,) * 3, np.uint8),
        sdf=np.zeros((COUNT,) * 3, np.float32),
    )
    distance = distance_at(places(blank)).astype(np.float32)
    passed, met = np.zeros(distance.shape, bool), np.zeros(distance.shape, bool)
    for axis, sign in ways:
        lines = np.moveaxis(distance, axis, 0)[::-sign]
        inside = lines < 0
        first = np.where(inside.any(axis=0), inside.argmax(axis=0), 10 * COUNT)
        ahead = first - np.arange(COUNT)[:, None, None]
        passed |= np.moveaxis((ahead > 0)[::-sign], 0, axis)
        met |= np.moveaxis((np.abs(ahead) <= 3)[::-sign], 0, axis)
    surface = met & (np.abs(distance) < BAND)
    state = np.where(surface, Evidence.SURFACE, np.where(passed, Evidence.EMPTY, Evidence.UNKNOWN)).astype(np.uint8)
    evidence = EvidenceGrid(
        origin=blank.origin, voxel=VOXEL, state=state, sdf=np.where(surface, distance, 0).astype(np.float32)
    )
    vertices, faces = grid_surface(distance, blank.origin, VOXEL)
    at = np.rint((vertices - blank.origin) / VOXEL).astype(int)
    faces = faces[surface[tuple(at.T)][faces].all(axis=1)]
    used, number = np.unique(faces, return_inverse=True)
    mesh = Mesh(vertices=vertices[used], faces=number.reshape(-1, 3).astype(np.int32))
    return Measured(mesh=mesh, evidence=evidence), distance_at(places(with_margin(evidence))) / VOXEL


def box(half, centre=(0.0, 0.0, 0.0)):
    def distance(at):
        off = np.abs(at - np.array(centre)) - np.array(half)
        return np.linalg.norm(np.maximum(off, 0), axis=-1) + np.minimum(off.max(axis=-1), 0)

    return distance


def bowl(at):
    """A ball's lower half with a smaller ball cut out, turned about z."""
    shell = np.linalg.norm(at, axis=-1)
    return np.maximum.reduce([shell - 0.7, 0.45 - shell, at[..., 2]])


def overlap(inside, truth):
    return (inside & truth).sum() / (inside | truth).sum()
