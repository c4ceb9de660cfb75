"""Settings of fusion."""

from dataclasses import dataclass
from typing import Annotated

from goc.settings import Positive, Range, Settings


@dataclass(frozen=True, kw_only=True)
class FusionConfig(Settings):
    """How depth views are fused round one object. Lengths in metres; a capture's unit scales them."""

    object_voxel: Positive = 0.008
    """Voxel of an object's mesh, metres, where object_cells does not ask for a finer one."""
    object_cells: Annotated[int, Range(least=1, most=2048)] = 48
    """Voxels along the longest side that every object gets at least: small things are meshed finer."""
    finest_voxel: Positive = 0.001
    """No voxel of an object's mesh or evidence is smaller, metres; pixels and the noise of depth set it higher."""
    truncation_voxels: Annotated[float, Range(least=2, most=64)] = 3.0
    """Half the width of the band round a measured surface that one view speaks for, voxels; below 2 it has holes.
    Given depth of little noise gets less, down to 2."""
    evidence_cells: Annotated[int, Range(least=1, most=1024)] = 128
    """Voxels along the longest side of an object's evidence grid; up to twice as many if object_voxel asks for it."""
    evidence_pad: Positive = 0.04
    """Room left round an object's measured points in its evidence grid, metres."""
    empty_votes: Positive = 0.5
    """A surface falls where rays that passed through outweigh those that ended there by this factor."""
    other_votes: Positive = 4.0
    """A surface falls where rays that ended on another id outweigh the object's own by this factor."""
