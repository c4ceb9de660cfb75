"""Triangle meshes as surfaces."""

import numpy as np
from jaxtyping import Float32, Float64

from goc.scene import Mesh


def face_areas(mesh: Mesh) -> Float64[np.ndarray, "t"]:
    """Areas of a mesh's faces."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


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
