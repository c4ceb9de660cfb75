"""Settings of stage 3."""

from dataclasses import dataclass, fields

from goc.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ExtractConfig:
    """How meshes are taken from depth and ids. Lengths in metres; a capture's unit scales them."""

    scene_voxel: float = 0.02
    """Voxel of the scene mesh, metres; doubled until the scene fits into memory_blocks."""
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
    least_views: int = 3
    """Views that must have measured a scene surface; a tenth of all views where that is fewer."""
    empty_votes: float = 0.5
    """A surface falls where rays that passed through outweigh those that ended there by this factor."""
    other_votes: float = 4.0
    """A surface falls where rays that ended on another id outweigh the object's own by this factor."""
    crumb_share: float = 0.01
    """Pieces below this share of the area go unless nearly every ray agrees with them; below a tenth of it always."""
    memory_blocks: int = 32768
    """Blocks of 512 voxels (16 KiB) held at once; more objects than fit are done in turns."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        for item in fields(self):
            if not getattr(self, item.name) > 0:
                raise ConfigError(f"extract.{item.name} is {getattr(self, item.name)}: it must be above 0.")
        if self.truncation_voxels < 2.0:
            raise ConfigError(
                f"extract.truncation_voxels is {self.truncation_voxels}: a band below 2 voxels leaves holes."
            )
