"""Settings of stage 3."""

from dataclasses import dataclass
from typing import Annotated

from goc.errors import ConfigError
from goc.fusion import FusionConfig
from goc.settings import Count, Finite, Positive, Range, Settings, Share


@dataclass(frozen=True, kw_only=True)
class ExtractConfig(FusionConfig):
    """How meshes are taken from depth and ids. Lengths in metres; a capture's unit scales them."""

    scene_voxel: Positive = 0.02
    """Voxel of the scene mesh, metres; doubled until the scene fits into memory_blocks."""
    min_views: Count = 3
    """Views that must have measured a scene surface; a tenth of all views where that is fewer."""
    floater_share: Share = 0.01
    """Pieces below this share of the area go unless nearly every ray agrees with them; below a tenth of it always."""
    memory_blocks: Annotated[int, Range(least=32)] = 32768
    """Blocks of 512 voxels (16 KiB) held at once; more objects than fit are done in turns."""


@dataclass(frozen=True, kw_only=True)
class WorldConfig(Settings):
    """Which way is up, for those who know better than the planes that goc finds. In the capture's world and units."""

    up: tuple[Finite, Finite, Finite] | None = None
    """Direction against gravity, of any length; found from level surfaces and cameras if not given."""
    floor: Finite | None = None
    """Height of the floor along up; found if not given."""

    def __post_init__(self) -> None:
        """Refuse a direction that is none."""
        super().__post_init__()
        if self.up is not None and not any(self.up):
            raise ConfigError("{up} is 0 0 0: needs a direction, such as 0 0 1.", type(self))
