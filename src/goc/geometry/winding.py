"""Faces wound like their neighbours."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from goc.geometry.surfaces import face_areas
from goc.scene import Mesh


def consistently_wound(mesh: Mesh) -> tuple[Mesh, int]:
    """Turn faces round that are wound against their neighbours, as few of each connected part as there are.

    Faces are neighbours that share an edge with no third one. The way in which most of a part's area is wound stays.
    Parts that no choice makes agree, such as a Möbius strip, stay as they are.

    Returns:
        The mesh, and how many faces were turned.
    """
    turned = _turned(mesh.faces.astype(np.int64), face_areas(mesh))
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    return replace(mesh, faces=np.ascontiguousarray(faces)), int(turned.sum())


def _turned(faces: Int64[np.ndarray, "t 3"], areas: Float64[np.ndarray, "t"]) -> Bool[np.ndarray, "t"]:
    """Each face is two nodes, itself and itself turned; neighbours that agree join the same sides, others the other."""
    count = len(faces)
    first, second, against = _neighbours(faces)
    ends = np.where(against, second + count, second), np.where(against, second, second + count)
    rows, columns = np.concatenate([first, first + count]), np.concatenate(ends)
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    parts, part = connected_components(graph, directed=False)
    weight = np.bincount(part[:count], areas, parts)  # area that keeps its way, should the part be chosen
    kept, other = part[:count], part[count:]
    return (kept != other) & ((weight[kept] < weight[other]) | ((weight[kept] == weight[other]) & (kept > other)))


def _neighbours(
    faces: Int64[np.ndarray, "t 3"],
) -> tuple[Int64[np.ndarray, "e"], Int64[np.ndarray, "e"], Bool[np.ndarray, "e"]]:
    """Pairs of faces that alone share an edge, and whether both run along it in the same direction."""
    starts, stops = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    owner = np.repeat(np.arange(len(faces)), 3)
    forward = starts < stops
    key = np.minimum(starts, stops) * (int(faces.max(initial=0)) + 1) + np.maximum(starts, stops)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    same = ordered[1:] == ordered[:-1]
    alone = same & ~np.append(same[1:], False) & ~np.append(False, same[:-1])
    left, right = order[:-1][alone], order[1:][alone]
    differ = owner[left] != owner[right]
    left, right = left[differ], right[differ]
    return owner[left], owner[right], forward[left] == forward[right]
