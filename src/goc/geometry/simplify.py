"""A closed mesh with fewer and rounder faces, within a tolerance."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from goc import _native
from goc.scene import FlaggedMesh, Mesh

GOOD_FACE = 0.3
"""Quality below which a face is a sliver; see `face_qualities`."""


@dataclass(frozen=True, kw_only=True)
class SimplifyLimits:
    """How far a mesh may be simplified."""

    tolerance: float
    """Greatest distance of the old surface (its vertices and the middles of its faces) from the new one, mesh units."""
    faces: int
    """Faces wanted; beyond them only slivers are taken away."""
    colour: float = 0.0
    """Length that a difference of one level of colour counts as: where colours differ, faces stay."""


def simplified(surface: FlaggedMesh, limits: SimplifyLimits) -> FlaggedMesh:
    """The same surface with fewer faces, and with next to none of bad shape.

    Edges are collapsed in the order of their quadric errors (Garland and Heckbert 1997), flipped, and vertices moved
    along the surface, as far as every point of the old surface stays within the tolerance. The line between observed
    and other vertices counts as a sharp edge, and no edge across it is collapsed but those of slivers.

    Args:
        surface: watertight as it is indexed (not checked here).
        limits: what is wanted, and what is allowed.

    Returns:
        Closed like the one given, with as many faces as wanted, or more where the tolerance forbids it. A vertex's
        colour is the mean of those merged into it, by area.

    Raises:
        ValueError: the tolerance is not above 0.
    """
    if not limits.tolerance > 0:
        raise ValueError(f"A tolerance of {limits.tolerance:g} allows no change.")
    mesh = surface.mesh
    colours = np.zeros((len(mesh.vertices), 3), np.uint8) if mesh.colours is None else mesh.colours
    vertices, faces, values, observed = _native.simplify(
        np.ascontiguousarray(mesh.vertices),
        np.ascontiguousarray(mesh.faces),
        colours.astype(np.float32),
        surface.observed.astype(np.uint8),
        limits.tolerance,
        limits.faces,
        GOOD_FACE,
        limits.colour,
    )
    mixed = None if mesh.colours is None else np.clip(np.rint(values), 0, 255).astype(np.uint8)
    return FlaggedMesh(mesh=Mesh(vertices=vertices, faces=faces, colours=mixed), observed=observed > 0)


def face_qualities(mesh: Mesh) -> Float64[np.ndarray, "t"]:
    """4√3 · area / sum of squared edges of each face: 1 where it is equilateral, 0 where it has no area."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
    edges = ((b - a) ** 2).sum(1) + ((c - b) ** 2).sum(1) + ((a - c) ** 2).sum(1)
    return 2 * np.sqrt(3) * np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(edges, 1e-300)
