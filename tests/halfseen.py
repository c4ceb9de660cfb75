"""A sphere of which only the upper half was seen, straight from above, with the evidence in closed form."""

import numpy as np

from goc.complete import Measured
from goc.geometry.isosurface import grid_surface
from goc.scene import Evidence, EvidenceGrid, FlaggedMesh, Mesh, SceneObject

RADIUS, CENTRE, VOXEL = 0.4, np.array([1.0, 2.0, 0.6]), 0.025
BAND = 3 * VOXEL


def positions(grid):
    """Centres of a grid's voxels."""
    axes = (np.arange(n) for n in grid.state.shape)
    return grid.origin + grid.voxel * np.stack(np.meshgrid(*axes, indexing="ij"), -1)


def sphere_distance(grid, centre, radius):
    return np.linalg.norm(positions(grid) - centre, axis=-1) - radius


def as_object(found, number=3, name="ball"):
    """What was measured, as extraction hands it on."""
    surface = FlaggedMesh(mesh=found.mesh, observed=np.ones(len(found.mesh.vertices), bool))
    return SceneObject(id=number, name=name, observed=surface, evidence=found.evidence)


def half_seen():
    """What was measured of it, its radius and centre. Rays come down along z, past it to the box's floor."""
    shape = (42, 42, 42)
    blank = EvidenceGrid(
        origin=CENTRE - VOXEL * 20.5,
        voxel=VOXEL,
        state=np.zeros(shape, np.uint8),
        sdf=np.zeros(shape, np.float32),
    )
    at = positions(blank) - CENTRE
    distance = np.linalg.norm(at, axis=-1) - RADIUS
    upper = at[..., 2] > 0
    beside = np.linalg.norm(at[..., :2], axis=-1) > RADIUS
    passed = beside | (upper & (distance > 0))
    surface = upper & (np.abs(distance) < BAND)
    state = np.where(surface, Evidence.SURFACE, np.where(passed, Evidence.EMPTY, Evidence.UNKNOWN))
    evidence = EvidenceGrid(
        origin=blank.origin,
        voxel=VOXEL,
        state=state.astype(np.uint8),
        sdf=np.where(surface, distance, 0).astype(np.float32),
    )
    vertices, faces = grid_surface(distance.astype(np.float32), blank.origin, VOXEL)
    cap = (vertices[faces][:, :, 2] > CENTRE[2]).all(axis=1)
    used = np.unique(faces[cap])
    number = np.zeros(len(vertices), np.int32)
    number[used] = np.arange(len(used))
    colours = np.where(vertices[used, :1] > CENTRE[0], [[220, 30, 30]], [[30, 30, 220]]).astype(np.uint8)
    mesh = Mesh(vertices=vertices[used], faces=number[faces[cap]], colours=colours)
    return Measured(mesh=mesh, evidence=evidence), RADIUS, CENTRE
