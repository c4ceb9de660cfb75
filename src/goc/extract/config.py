"""Settings of stage 3."""

from dataclasses import dataclass

from goc.fusion import FusionConfig


@dataclass(frozen=True, kw_only=True)
class ExtractConfig(FusionConfig):
    """How meshes are taken from depth and ids. Lengths in metres; a capture's unit scales them."""

    scene_voxel: float = 0.02
    """Voxel of the scene mesh, metres; doubled until the scene fits into memory_blocks."""
    min_views: int = 3
    """Views that must have measured a scene surface; a tenth of all views where that is fewer."""
    floater_share: float = 0.01
    """Pieces below this share of the area go unless nearly every ray agrees with them; below a tenth of it always."""
    memory_blocks: int = 32768
    """Blocks of 512 voxels (16 KiB) held at once; more objects than fit are done in turns."""
