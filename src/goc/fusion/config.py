"""Settings of fusion."""

from dataclasses import dataclass, fields

from goc.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class FusionConfig:
    """How depth views are fused round one object. Lengths in metres; a capture's unit scales them."""

    object_voxel: float = 0.008
    """Voxel of an object's mesh, metres, where object_cells does not ask for a finer one."""
    object_cells: int = 48
    """Voxels along the longest side that every object gets at least: small things are meshed finer."""
    finest_voxel: float = 0.003
    """No voxel of an object's mesh or evidence is smaller, metres: views must agree within its truncation."""
    truncation_voxels: float = 3.0
    """Half the width of the band round a measured surface that one view speaks for, voxels."""
    evidence_cells: int = 128
    """Voxels along the longest side of an object's evidence grid; up to twice as many if object_voxel asks for it."""
    evidence_pad: float = 0.04
    """Room left round an object's measured points in its evidence grid, metres."""
    empty_votes: float = 0.5
    """A surface falls where rays that passed through outweigh those that ended there by this factor."""
    other_votes: float = 4.0
    """A surface falls where rays that ended on another id outweigh the object's own by this factor."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        for item in fields(self):
            if not getattr(self, item.name) > 0:
                raise ConfigError(f"extract.{item.name} is {getattr(self, item.name)}: it must be above 0.")
        if self.truncation_voxels < 2.0:
            raise ConfigError(
                f"extract.truncation_voxels is {self.truncation_voxels}: a band below 2 voxels leaves holes."
            )
