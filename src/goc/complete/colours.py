"""Vertex colours of a completed mesh: measured where it was seen, spread smoothly from there elsewhere."""

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from goc.scene import Mesh

_ROUNDS = 40
_ANCHORS, _AT_ONCE = 256, 16384


def spread_colours(
    vertices: Float32[np.ndarray, "v 3"],
    faces: Int32[np.ndarray, "t 3"],
    observed: Bool[np.ndarray, "v"],
    measured: Mesh,
) -> UInt8[np.ndarray, "v 3"] | None:
    """Colours of a completed mesh from those of the measured one; None where that has none.

    Observed vertices get the mean of the nearest measured colours. The others start with a mean over some of the
    observed ones, the near before the far (Shepard 1968), and are evened out over the surface with the observed ones
    held, so that colours run on smoothly and no single spot spreads far.
    """
    if measured.colours is None or len(vertices) == 0 or len(measured.vertices) == 0:
        return None if measured.colours is None else np.zeros((len(vertices), 3), np.uint8)
    held = observed if observed.any() else np.ones(len(vertices), bool)
    colours = np.zeros((len(vertices), 3))
    apart, near = cKDTree(measured.vertices).query(vertices[held], k=[1, 2, 3, 4])
    known = np.isfinite(apart)  # fewer than four in all
    weight = known / np.maximum(apart, 1e-3 * max(float(np.median(apart[:, 0])), 1e-12)) ** 2
    near = np.where(known, near, 0)
    colours[held] = (measured.colours[near] * weight[..., None]).sum(1) / weight.sum(1, keepdims=True)
    chosen = np.random.default_rng(0).permutation(np.flatnonzero(held))[:_ANCHORS]
    colours[~held] = _weighed(vertices[~held], vertices[chosen], colours[chosen])
    around, count = _neighbours(faces, len(vertices))
    for _ in range(_ROUNDS):
        colours = np.where(held[:, None], colours, around @ colours / count)
    return np.clip(np.rint(colours), 0, 255).astype(np.uint8)


def _weighed(
    points: Float32[np.ndarray, "p 3"], anchors: Float32[np.ndarray, "a 3"], colours: Float64[np.ndarray, "a 3"]
) -> Float64[np.ndarray, "p 3"]:
    """Means of the anchors' colours, weighed by the fourth power of nearness."""
    centre = anchors.mean(axis=0)
    points, anchors = points - centre, anchors - centre
    least = 1e-6 * float((anchors**2).sum(axis=1).max()) + 1e-30
    means = np.zeros((len(points), 3))
    for start in range(0, len(points), _AT_ONCE):
        part = points[start : start + _AT_ONCE]
        squares = (part**2).sum(axis=1, keepdims=True) + (anchors**2).sum(axis=1) - 2.0 * part @ anchors.T
        weights = 1.0 / np.maximum(squares, least) ** 2
        means[start : start + _AT_ONCE] = weights @ colours / weights.sum(axis=1, keepdims=True)
    return means


def _neighbours(faces: Int32[np.ndarray, "t 3"], vertices: int) -> tuple[csr_array, np.ndarray]:
    """Adjacency matrix of the vertices, and the number of neighbours of each."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    links = coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(vertices, vertices)).tocsr()
    links = links + links.T
    return links, np.maximum(np.asarray(links.sum(axis=1)).reshape(-1, 1), 1.0)
