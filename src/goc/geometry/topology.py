"""Whether a mesh is closed or watertight, and its volume.

Corners at bitwise the same place count as one: files of scanned or textured meshes repeat them along seams.
"""

import numpy as np
from jaxtyping import Int64

from goc.scene import Mesh


def watertight_flaw(mesh: Mesh) -> str | None:
    """What keeps a mesh from being watertight, None where nothing does.

    Watertight: every edge lies on exactly two faces, which run along it in opposite directions; no face has zero area;
    the volume is positive. A mesh is watertight as it is indexed, or after corners at the same place are made one.
    """
    if len(mesh.faces) == 0:
        return "it has no faces"
    if not (_doubled_areas(mesh) > 0).all():
        return f"{int((_doubled_areas(mesh) <= 0).sum())} faces have no area"
    flaw = _edge_flaw(mesh.faces.astype(np.int64))
    if flaw is not None:
        flaw = _edge_flaw(_welded_faces(mesh))
    if flaw is None and not signed_volume(mesh) > 0:
        flaw = "it is turned inside out"
    return flaw


def is_watertight(mesh: Mesh) -> bool:
    """Whether `watertight_flaw` finds nothing."""
    return watertight_flaw(mesh) is None


def is_closed(mesh: Mesh) -> bool:
    """Whether the surface has no border: each edge is run along as often in one direction as in the other.

    Weaker than watertight: parts may touch, overlap or be turned inside out. Enough for inside and outside to exist.
    """
    forward, backward = _edges(_welded_faces(mesh))
    return len(mesh.faces) > 0 and np.array_equal(np.sort(forward), np.sort(backward))


def signed_volume(mesh: Mesh) -> float:
    """Volume by the divergence theorem, cubed units; negative for a closed mesh turned inside out."""
    if len(mesh.faces) == 0:
        return 0.0
    vertices = mesh.vertices.astype(np.float64)
    a, b, c = (vertices[mesh.faces[:, i]] - vertices[mesh.faces[0, 0]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _edge_flaw(faces: Int64[np.ndarray, "t 3"]) -> str | None:
    forward, backward = _edges(faces)
    edges = np.minimum(forward, backward)
    _, faces_of = np.unique(edges, return_counts=True)
    open_edges = int((faces_of == 1).sum())
    if open_edges:
        return f"{open_edges} edges have a face on one side only"
    _, which, directed = np.unique(forward, return_inverse=True, return_counts=True)
    repeated = len(np.unique(edges[directed[which] > 1]))
    return f"{repeated} edges are run along twice in the same direction" if repeated else None


def _edges(faces: Int64[np.ndarray, "t 3"]) -> tuple[Int64[np.ndarray, "e"], Int64[np.ndarray, "e"]]:
    """One number for each directed edge, and for the edge run the other way; edges from a corner to itself left out."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    return edges[:, 0] << 32 | edges[:, 1], edges[:, 1] << 32 | edges[:, 0]


def _welded_faces(mesh: Mesh) -> Int64[np.ndarray, "t 3"]:
    places = np.ascontiguousarray(mesh.vertices + np.float32(0)).view(np.uint32).astype(np.int64)  # + 0: -0 is 0
    order = np.lexsort(places.T)
    new = np.concatenate([[True], (places[order][1:] != places[order][:-1]).any(axis=1)]) if len(order) else order > 0
    name = np.zeros(len(places), np.int64)
    name[order] = np.cumsum(new) - 1
    return name[mesh.faces.astype(np.int64)]


def _doubled_areas(mesh: Mesh) -> np.ndarray:
    vertices = mesh.vertices.astype(np.float64)
    a, b, c = (vertices[mesh.faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1)
