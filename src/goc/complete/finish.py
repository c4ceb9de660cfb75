"""The surface that an object leaves completion with: relaxed where imagined, light, without slivers, coloured."""

from dataclasses import replace

import numpy as np

from goc.complete.colours import inpainted, with_measured_colours
from goc.complete.compose import Composition, bare_surface
from goc.geometry.relax import relaxed_surface, without_cuts
from goc.geometry.simplify import SimplifyLimits, simplified
from goc.geometry.topology import watertight_flaw
from goc.scene import FlaggedMesh, Mesh

_ROUNDS = 20
"""Of relaxing: 32 % of the gap in normals between imagined and measured surface, and nothing lost in place (0041)."""
_ON_PLANE = 0.01
"""Voxels within which a vertex is on a plane that the field was cut at."""
_TOLERANCE = 0.001
"""Simplified surfaces stay this near to the full one, metres …"""
_SMALL, _VOXELS = 0.002, 0.1
"""… and within this share of the longest side, or this many voxels where that is more."""
_LEVELS = 50
"""Levels of colour whose difference counts like the tolerance."""


def finished_surface(composed: Composition, seen: Mesh, faces: int, units_per_metre: float) -> FlaggedMesh:
    """The closed surface of a composed field as it is handed on.

    Imagined vertices are relaxed; measured ones stay. Then the surface is simplified to `faces` faces, as far as
    that takes it no further than a millimetre from itself, or less for small things. Colours are the measured ones,
    and smoothly inpainted where nothing was measured.

    Args:
        composed: see `compose_field`.
        seen: the measured surface; its colours are used.
        faces: faces wanted; 0 keeps them all.
        units_per_metre: scene units in one metre.

    Returns:
        A watertight surface wherever that of the field is one.
    """
    surface = with_measured_colours(bare_surface(composed), seen)
    if watertight_flaw(surface.mesh) is None:
        finished = _even(surface, composed)
        if faces > 0:
            finished = _light(finished, faces, composed.evidence.voxel, units_per_metre)
        if watertight_flaw(finished.mesh) is None:
            surface = finished
    return inpainted(surface)


def _even(surface: FlaggedMesh, composed: Composition) -> FlaggedMesh:
    """Relaxed, with vertices on the planes that the field was cut at still on them: a flat bottom stays flat."""
    places = relaxed_surface(surface.mesh, ~surface.observed, _ROUNDS)
    for plane in composed.planes:
        on = np.abs(plane.depth(surface.mesh.vertices)) < _ON_PLANE * composed.evidence.voxel
        places[on] -= (plane.depth(places[on])[:, None] * plane.normal).astype(np.float32)
    return replace(surface, mesh=replace(surface.mesh, vertices=without_cuts(surface.mesh, places)))


def _light(surface: FlaggedMesh, faces: int, voxel: float, units_per_metre: float) -> FlaggedMesh:
    longest = float(np.ptp(surface.mesh.vertices, axis=0).max())
    tolerance = min(_TOLERANCE * units_per_metre, max(_SMALL * longest, _VOXELS * voxel))
    return simplified(surface, SimplifyLimits(tolerance=tolerance, faces=faces, colour=tolerance / _LEVELS))
