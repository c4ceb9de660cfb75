"""Every ray against every triangle, as in Möller and Trumbore (1997): the obvious twin of goc.geometry.raycast."""

import numpy as np


def closest_hits(vertices, faces, origins, directions):
    """t (infinity: none) and triangle (-1: none) of each ray's nearest hit, float64."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    t_all = np.full((len(origins), len(faces)), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for ray, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
            p = np.cross(direction, c - a)
            inverse = 1.0 / ((b - a) * p).sum(-1)
            s = origin - a
            u = (s * p).sum(-1) * inverse
            q = np.cross(s, b - a)
            v = (q @ direction) * inverse
            t = ((c - a) * q).sum(-1) * inverse
            inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
            t_all[ray, inside] = t[inside]
    triangle = t_all.argmin(-1)
    t = t_all[np.arange(len(origins)), triangle]
    return t, np.where(np.isfinite(t), triangle, -1)
