"""Triangle meshes as surfaces."""

import numpy as np
from jaxtyping import Float32, Float64

from goc.scene import Mesh, PointCloud

_NO_COLOUR = 128  # mid grey, sRGB


def face_areas(mesh: Mesh) -> Float64[np.ndarray, "t"]:
    """Areas of a mesh's faces."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def surface_cloud(mesh: Mesh, count: int, seed: int = 0) -> PointCloud:
    """Area-uniform points on a mesh, with the normals of their faces and colours between those of the corners.

    Raises:
        ValueError: the mesh has no area.
    """
    areas = face_areas(mesh)
    total = np.cumsum(areas)
    if len(total) == 0 or not total[-1] > 0:
        raise ValueError(f"A mesh of {len(areas)} faces has no area to put points on.")
    random = np.random.default_rng(seed)
    at = (np.arange(count) + random.random(count)) / count * float(total[-1])
    face = mesh.faces[np.minimum(np.searchsorted(total, at, side="right"), np.flatnonzero(areas)[-1])]
    root, share = np.sqrt(random.random(count)), random.random(count)
    weights = np.stack([1 - root, root * (1 - share), root * share], axis=1)[..., None]
    a, b, c = mesh.vertices[face].astype(np.float64).transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    colours = np.full((len(mesh.vertices), 3), _NO_COLOUR, np.uint8) if mesh.colours is None else mesh.colours
    return PointCloud(
        positions=(np.stack([a, b, c], axis=1) * weights).sum(axis=1).astype(np.float32),
        colours=np.rint((colours[face] * weights).sum(axis=1)).astype(np.uint8),
        normals=normals.astype(np.float32),
    )


def vertex_normals(mesh: Mesh) -> Float32[np.ndarray, "v 3"]:
    """Unit normals at the vertices, means of the faces' normals by area; zero where no face has area."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    at = mesh.faces.ravel()
    sums = np.stack(
        [np.bincount(at, np.repeat(faces[:, axis], 3), minlength=len(mesh.vertices)) for axis in range(3)], axis=1
    )
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return (sums / np.where(length > 0, length, 1.0)).astype(np.float32)
