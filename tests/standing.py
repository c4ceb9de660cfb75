"""Boxes that stand on each other, a floor and a wall, as cameras above would have measured them: in closed form."""

import numpy as np

from goc.scene import Evidence, EvidenceGrid, FlaggedMesh, Mesh, SceneObject, World
from halfseen import positions
from solids import joined

VOXEL = 0.01
BAND = 3 * VOXEL
UPRIGHT = np.eye(4)


def patch(corner, first, second, step=0.01) -> Mesh:
    """A parallelogram of small faces that look along first × second."""
    corner, first, second = (np.array(value, np.float64) for value in (corner, first, second))
    n, m = (int(np.ceil(np.linalg.norm(side) / step)) for side in (first, second))
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    at = (np.arange(n)[:, None] * (m + 1) + np.arange(m)).ravel()
    faces = np.concatenate([np.stack([at, at + m + 1, at + m + 2], axis=1), np.stack([at, at + m + 2, at + 1], axis=1)])
    vertices = corner + u.reshape(-1, 1) * first + v.reshape(-1, 1) * second
    return Mesh(vertices=vertices.astype(np.float32), faces=faces.astype(np.int32))


def open_box(low, high) -> Mesh:
    """A box without its underside."""
    x, y, z = np.array(high, np.float64) - low
    a = np.array(low, np.float64)
    return joined(
        patch(a + [0, 0, z], [x, 0, 0], [0, y, 0]),
        patch(a, [x, 0, 0], [0, 0, z]),
        patch(a + [x, 0, 0], [0, y, 0], [0, 0, z]),
        patch(a + [x, y, 0], [-x, 0, 0], [0, 0, z]),
        patch(a + [0, y, 0], [0, -y, 0], [0, 0, z]),
    )


def floor(side=1.5, height=0.0) -> Mesh:
    return patch([-side / 2, -side / 2, height], [side, 0, 0], [0, side, 0], 0.02)


def at(mesh: Mesh, pose) -> Mesh:
    """A mesh moved by a similarity."""
    moved = mesh.vertices.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
    return Mesh(vertices=moved.astype(np.float32), faces=mesh.faces)


def thing(number, boxes, shade=(), pose=UPRIGHT, hidden=0.0) -> SceneObject:
    """An object of boxes, of which no camera saw the lowest underside.

    Args:
        number: its id.
        boxes: least and greatest corner of each, upright.
        shade: boxes in which nothing was seen, besides its own inside and what is below the floor.
        pose: world from upright.
        hidden: height below which no camera saw anything.
    """
    mesh = at(joined(*(open_box(*box) for box in boxes)), pose)
    low, high = mesh.vertices.min(axis=0) - 0.051, mesh.vertices.max(axis=0) + 0.052
    shape = np.ceil((high - low) / VOXEL).astype(int) + 1
    blank = EvidenceGrid(
        origin=low.astype(np.float64), voxel=VOXEL, state=np.zeros(shape, np.uint8), sdf=np.zeros(shape, np.float32)
    )
    where = (positions(blank) - pose[:3, 3]) @ pose[:3, :3]  # rigid: the inverse is the transpose
    distance = np.min([box_distance(where, box) for box in boxes], axis=0)
    dark = (where[..., 2] < hidden) | np.any([box_distance(where, box) < 0 for box in shade] or [False], axis=0)
    lowest = min(box[0][2] for box in boxes)
    seen = np.min([box_distance(where, box, open_below=box[0][2] == lowest) for box in boxes], axis=0)
    surface = (np.abs(seen) < BAND) & ~dark & (where[..., 2] > lowest)
    state = np.where(surface, Evidence.SURFACE, np.where((distance < 0) | dark, Evidence.UNKNOWN, Evidence.EMPTY))
    evidence = EvidenceGrid(
        origin=blank.origin,
        voxel=VOXEL,
        state=state.astype(np.uint8),
        sdf=np.where(surface, seen, 0).astype(np.float32),
    )
    observed = FlaggedMesh(mesh=mesh, observed=np.ones(len(mesh.vertices), bool))
    return SceneObject(id=number, name=f"thing {number}", observed=observed, evidence=evidence)


def box_distance(points, box, open_below=False):
    """Signed distance to a box; to its sides and top alone, if it is open below."""
    low, high = (np.array(corner, np.float64) for corner in box)
    if open_below:
        low = low * [1, 1, 0] - [0, 0, 9]
    away = np.abs(points - (low + high) / 2) - (high - low) / 2
    return np.linalg.norm(np.maximum(away, 0), axis=-1) + np.minimum(away.max(axis=-1), 0)


def world(pose=UPRIGHT, confidence=1.0) -> World:
    """The world in which `pose` takes what is upright."""
    up = pose[:3, 2] / np.linalg.norm(pose[:3, 2])
    scale = float(np.linalg.norm(pose[:3, 0]))
    floor_height = float(up @ pose[:3, 3])
    return World(up=up, floor=floor_height, confidence=confidence, units_per_metre=scale, metric=True)
