"""Vertex colours of a completed mesh: measured where it was seen, spread smoothly from there elsewhere."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float32, Float64
from scipy.spatial import cKDTree

from goc.complete.stains import stain_weights
from goc.geometry.relax import vertex_links
from goc.scene import FlaggedMesh, Mesh

_ROUNDS = 40
_ANCHORS, _AT_ONCE = 256, 16384


def with_measured_colours(surface: FlaggedMesh, seen: Mesh) -> FlaggedMesh:
    """The surface with colours: observed vertices get means of the nearest measured ones, the others are black.

    Where nothing is observed, every vertex gets the nearest measured colours. Without measured colours there are none.
    """
    places = surface.mesh.vertices
    if seen.colours is None:
        return replace(surface, mesh=replace(surface.mesh, colours=None))
    colours = np.zeros((len(places), 3), np.uint8)
    held = surface.observed if surface.observed.any() else np.ones(len(places), bool)
    if held.any() and len(seen.vertices):
        apart, near = cKDTree(seen.vertices).query(places[held], k=[1, 2, 3, 4])
        known = np.isfinite(apart)  # fewer than four in all
        weight = known / np.maximum(apart, 1e-3 * max(float(np.median(apart[:, 0])), 1e-12)) ** 2
        near = np.where(known, near, 0)
        means = (seen.colours[near] * weight[..., None]).sum(1) / weight.sum(1, keepdims=True)
        colours[held] = np.clip(np.rint(means), 0, 255)
    return replace(surface, mesh=replace(surface.mesh, colours=colours))


def inpainted(surface: FlaggedMesh) -> FlaggedMesh:
    """The surface with the colours of its observed vertices spread over the others.

    The others start with a mean over some of the observed ones, the near before the far (Shepard 1968), and are evened
    out over the surface with the observed ones held, so that colours run on smoothly and no single spot spreads far.
    Round the places where things stood the measured colours give way to what surrounds them: see `stain_weights`.
    """
    mesh = surface.mesh
    if mesh.colours is None or surface.observed.all() or not surface.observed.any():
        return surface
    stained = stain_weights(surface)[:, None]
    held = surface.observed & (stained[:, 0] == 0)
    if not held.any():
        held, stained = surface.observed, np.zeros_like(stained)
    colours = mesh.colours.astype(np.float64)
    chosen = np.random.default_rng(0).permutation(np.flatnonzero(held))[:_ANCHORS]
    colours[~held] = _weighed(mesh.vertices[~held], mesh.vertices[chosen], colours[chosen])
    around = vertex_links(mesh.faces, len(mesh.vertices))
    count = np.maximum(around.sum(axis=1).reshape(-1, 1), 1.0)
    for _ in range(_ROUNDS):
        colours = np.where(held[:, None], colours, around @ colours / count)
    told = surface.observed[:, None]
    colours = np.where(told, (1 - stained) * mesh.colours + stained * colours, colours)
    return replace(surface, mesh=replace(mesh, colours=np.clip(np.rint(colours), 0, 255).astype(np.uint8)))


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
