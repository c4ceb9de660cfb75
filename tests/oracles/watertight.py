"""What "watertight" means here, checked without any library (docs/decisions/0021)."""

import numpy as np


def signed_volume(vertices, faces):
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def trouble(vertices, faces):
    """Empty for a closed mesh with consistent winding, no zero-area face, positive volume; else what is wrong."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    forward = edges[:, 0] * len(vertices) + edges[:, 1]
    backward = edges[:, 1] * len(vertices) + edges[:, 0]
    if len(np.unique(forward)) != len(forward):
        return "an edge is used twice in the same direction"
    if not np.array_equal(np.sort(forward), np.sort(backward)):
        return "an edge has no partner"
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    if np.linalg.norm(np.cross(b - a, c - a), axis=-1).min() <= 0:
        return "a face has no area"
    return "" if signed_volume(vertices, faces) > 0 else "turned inside out"
