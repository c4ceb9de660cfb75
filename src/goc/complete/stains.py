"""Where things stood: flat places that were hidden, and the shaded rims round them."""

import numpy as np
from jaxtyping import Float32, Float64, Int64
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from goc.geometry.relax import vertex_links
from goc.geometry.surfaces import vertex_normals
from goc.scene import FlaggedMesh

_FLAT = 0.9
"""Length of the mean normal round a hidden place from which on it is a place on a plane, and not an underside."""
_FEWEST = 3
"""Vertices of a hidden place; smaller ones are specks of the measurement."""
_WIDTH = 0.5
"""Width of the rim in widths of the place: about as far as the shadow of what stood there is seen. The inner half of
it counts in full."""


def stain_weights(surface: FlaggedMesh) -> Float64[np.ndarray, "v"]:
    """How little a vertex's measured colour says of the surface: 1 beside a place where a thing stood, 0 elsewhere.

    Cameras saw the shadow round a thing, and pixels that mix both. Places are pieces of imagined surface with a flat
    rim all round. Vertices that were not observed have 0.
    """
    weights = np.zeros(len(surface.observed))
    links = vertex_links(surface.mesh.faces, len(weights))
    normals, places = vertex_normals(surface.mesh), surface.mesh.vertices
    seen = np.flatnonzero(surface.observed)
    for place in _hidden_places(surface, links):
        rim = np.unique(links[place].indices)
        rim = rim[surface.observed[rim]]
        up = normals[rim].mean(axis=0) if len(rim) > 2 else np.zeros(3, np.float32)
        reach = _WIDTH * _width(places[place])
        if not float(np.linalg.norm(up)) > _FLAT or not reach > 0:
            continue
        apart = cKDTree(places[place]).query(places[seen], distance_upper_bound=reach)[0]
        apart[normals[seen] @ up < _FLAT**2] = np.inf  # the plane's own vertices, not those round its corner
        weights[seen] = np.maximum(weights[seen], np.clip(2.0 - 2.0 * apart / reach, 0.0, 1.0))
    return weights


def _width(points: Float32[np.ndarray, "p 3"]) -> float:
    """The middle one of a flat patch's three extents, of a rectangle its shorter side."""
    return float(np.sqrt(12 * max(np.linalg.eigvalsh(np.cov(points.T.astype(np.float64)))[1], 0.0)))


def _hidden_places(surface: FlaggedMesh, links: csr_array) -> list[Int64[np.ndarray, "p"]]:
    """Vertices of each connected piece of imagined surface but for specks."""
    hidden = np.flatnonzero(~surface.observed)
    count, piece = connected_components(links[hidden][:, hidden], directed=False)
    order = np.argsort(piece, kind="stable")
    ends = np.cumsum(np.bincount(piece, minlength=count))
    pieces = np.split(hidden[order], ends[:-1]) if count else []
    return [found for found in pieces if len(found) >= _FEWEST]
