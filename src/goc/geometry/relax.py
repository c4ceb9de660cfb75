"""Evening out a part of a surface, while edges stay edges."""

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64
from scipy.sparse import csr_array

from goc.geometry.raycast import TriangleScene
from goc.geometry.surfaces import vertex_normals
from goc.scene import Mesh

_RENEWED = 5
"""Rounds after which normals are taken anew."""
_RINGS = 2
"""Rings over which normals are averaged before they are compared."""
_ALIKE = 0.3
"""Distance of unit normals at which a neighbour's pull falls to 0.6: about 17 degrees."""

_MENDS = 8
"""Rounds in which places are mended before all go home."""


def relaxed_surface(mesh: Mesh, free: Bool[np.ndarray, "v"], rounds: int) -> Float32[np.ndarray, "v 3"]:
    """Places of the vertices after the free ones were drawn towards the means of their neighbours; the rest stay.

    A neighbour pulls the less, the more its normal differs (as Tomasi and Manduchi 1998 do for images): planes become
    planes, and the edge between two of them stays where it is. Slivers vanish as a matter of course.

    Args:
        mesh: a closed or open surface.
        free: vertices that may move.
        rounds: each goes half of the way.
    """
    rows = np.flatnonzero(free)
    places = mesh.vertices.copy()
    if len(rows) == 0:
        return places
    links = vertex_links(mesh.faces, len(places))
    pull = links[rows]
    for turn in range(rounds):
        if turn % _RENEWED == 0:
            normals = _smooth_normals(Mesh(vertices=places, faces=mesh.faces), links)
            pull = _pull(links, normals, rows)
        places[rows] += np.float32(0.5) * (pull @ places - places[rows])
    return places


def without_cuts(mesh: Mesh, places: Float32[np.ndarray, "v 3"]) -> Float32[np.ndarray, "v 3"]:
    """Moved places of a mesh's vertices, with those back home whose faces cut others or have lost their area.

    Each round that does not mend a place takes its neighbours home too; after some rounds, all.

    Args:
        mesh: as it was before; no two of its faces cut each other, so that going home mends everything.
        places: of the vertices now.
    """
    places, faces = places.copy(), mesh.faces
    home = np.zeros(len(places), bool)
    asked = _touching(faces, (places != mesh.vertices).any(axis=1))
    for _ in range(_MENDS):
        bad = faces[_spoilt(places, faces, asked)]
        if len(bad) == 0:
            return places
        called = np.zeros(len(places), bool)
        called[bad] = True
        called[faces[np.isin(faces, bad[home[bad].all(axis=1)]).any(axis=1)]] = True
        asked, home = _touching(faces, called), home | called
        places[called] = mesh.vertices[called]
    return places if not _spoilt(places, faces, asked).any() else mesh.vertices.copy()


def _touching(faces: Int32[np.ndarray, "t 3"], chosen: Bool[np.ndarray, "v"]) -> Bool[np.ndarray, "t"]:
    """Which faces have a chosen vertex."""
    return chosen[faces[:, 0]] | chosen[faces[:, 1]] | chosen[faces[:, 2]]


def _spoilt(
    places: Float32[np.ndarray, "v 3"], faces: Int32[np.ndarray, "t 3"], asked: Bool[np.ndarray, "t"]
) -> Bool[np.ndarray, "t"]:
    """Which of the faces asked for cut others or have no area."""
    spoilt = TriangleScene(places, faces).crossings(asked) > 0
    a, b, c = (places[faces[asked, corner]].astype(np.float64) for corner in range(3))
    spoilt[asked] |= (np.cross(b - a, c - a) == 0).all(axis=1)
    return spoilt


def vertex_links(faces: Int32[np.ndarray, "t 3"], count: int) -> csr_array:
    """Matrix of `count` vertices with a 1 for each pair that shares an edge, on either side of the diagonal."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    first, second = np.concatenate([ends, ends[:, ::-1]]).T
    links = csr_array((np.ones(len(first), np.float32), (first, second)), shape=(count, count))
    links.data[:] = 1.0  # a pair of each face of an edge was summed
    return links


def _smooth_normals(mesh: Mesh, links: csr_array) -> Float32[np.ndarray, "v 3"]:
    normals = vertex_normals(mesh)
    for _ in range(_RINGS):
        normals = links @ normals + normals
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.float32(1e-12))
    return normals


def _pull(links: csr_array, normals: Float32[np.ndarray, "v 3"], rows: Int64[np.ndarray, "r"]) -> csr_array:
    """Weights of each chosen vertex's neighbours, with sum 1."""
    near = links[rows].tocoo()
    at, around = near.coords
    apart = ((normals[rows[at]] - normals[around]) ** 2).sum(axis=1)
    weight = np.maximum(np.exp(-apart / np.float32(2 * _ALIKE**2)), np.float32(1e-6))
    total = np.bincount(at, weight, minlength=len(rows))
    return csr_array(((weight / total[at]).astype(np.float32), (at, around)), shape=near.shape)
