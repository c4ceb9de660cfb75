"""What "watertight" means here, checked without any library (docs/decisions/0021)."""

import numpy as np


def signed_volume(vertices, faces):
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def directed_edges(faces):
    """One number for each edge as its faces run along it, sorted, and the same for the opposite direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    count = int(faces.max(initial=-1)) + 1
    return np.sort(edges[:, 0] * count + edges[:, 1]), np.sort(edges[:, 1] * count + edges[:, 0])


def has_border(faces):
    """Whether some edge is run along more often in one direction than in the other."""
    forward, backward = directed_edges(faces)
    return not np.array_equal(forward, backward)


def trouble(vertices, faces):
    """Empty for a closed mesh with consistent winding, no zero-area face, positive volume; else what is wrong."""
    forward, _ = directed_edges(faces)
    if len(np.unique(forward)) != len(forward):
        return "an edge is used twice in the same direction"
    if has_border(faces):
        return "an edge has no partner"
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    if np.linalg.norm(np.cross(b - a, c - a), axis=-1).min() <= 0:
        return "a face has no area"
    return "" if signed_volume(vertices, faces) > 0 else "turned inside out"
