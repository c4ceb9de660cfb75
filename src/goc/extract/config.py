"""Settings of stage 3."""

import math
from dataclasses import dataclass

from goc.errors import ConfigError
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


@dataclass(frozen=True, kw_only=True)
class WorldConfig:
    """Which way is up, for those who know better than the planes that goc finds. In the capture's world and units."""

    up: tuple[float, float, float] | None = None
    """Direction against gravity, of any length; found from level surfaces and cameras if not given."""
    floor: float | None = None
    """Height of the floor along up; found if not given."""

    def __post_init__(self) -> None:
        """Refuse a direction that is none, and a height that is none."""
        if self.up is not None and not (all(map(math.isfinite, self.up)) and any(self.up)):
            given = " ".join(f"{value:g}" for value in self.up)
            raise ConfigError(f"--world.up is {given}: needs three finite numbers, not all 0, such as 0 0 1.")
        if self.floor is not None and not math.isfinite(self.floor):
            raise ConfigError(f"--world.floor is {self.floor:g}: needs a finite height along up, in scene units.")
