"""Dropping floaters: small loose pieces of surface that few rays support."""

import numpy as np
from jaxtyping import Bool, Float32, Int32
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from goc.fusion.volume import FusedSurface
from goc.scene import Mesh

_SURE = 0.75
"""A small piece stays where at least this share of the rays that reached it ended on it."""


def without_floaters(surface: FusedSurface, share: float) -> FusedSurface:
    """Drop connected pieces that are small and doubted; the largest piece always stays.

    A piece below `share` of the whole area goes unless rays agree on it, below a tenth of it in any case.
    """
    if len(surface.mesh.faces) == 0:
        return surface
    faces = surface.mesh.faces
    piece = face_pieces(faces, len(surface.mesh.vertices))
    area = face_areas(surface.mesh)
    total = np.bincount(piece, weights=area)
    trust = np.bincount(piece, weights=area * surface.agreement[faces].mean(axis=1)) / np.maximum(total, 1e-30)
    part = total / max(float(total.sum()), 1e-30)
    keep = (part >= share) | ((part >= 0.1 * share) & (trust >= _SURE))
    keep[np.argmax(total)] = True
    return with_faces(surface, keep[piece])


def face_pieces(faces: Int32[np.ndarray, "t 3"], vertices: int) -> Int32[np.ndarray, "t"]:
    """Number of the connected piece that each face is in."""
    ends = np.concatenate([faces[:, :2], faces[:, 1:]]).T
    graph = coo_array((np.ones(ends.shape[1], np.int8), (ends[0], ends[1])), shape=(vertices, vertices))
    return connected_components(graph, directed=False)[1][faces[:, 0]].astype(np.int32)


def face_areas(mesh: Mesh) -> Float32[np.ndarray, "t"]:
    """Areas of a mesh's faces."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return (np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2).astype(np.float32)


def with_faces(surface: FusedSurface, keep: Bool[np.ndarray, "t"]) -> FusedSurface:
    """Only the faces told, and the vertices they use."""
    faces = surface.mesh.faces[keep]
    used = np.zeros(len(surface.mesh.vertices), bool)
    used[faces] = True
    number = np.cumsum(used) - 1
    colours = surface.mesh.colours
    mesh = Mesh(
        vertices=surface.mesh.vertices[used],
        faces=number[faces].astype(np.int32),
        colours=None if colours is None else colours[used],
    )
    return FusedSurface(mesh=mesh, weight=surface.weight[used], agreement=surface.agreement[used])
