"""Settings of stage 6."""

from dataclasses import dataclass

from goc.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """What is written, and where nothing may be overwritten."""

    overwrite: bool = False
    """Replace what an earlier run wrote into the same folder; other files there stay."""
    overview_views: int = 3
    """Views shown in overview.png."""

    def __post_init__(self) -> None:
        if not 1 <= self.overview_views <= 40:
            raise ConfigError(f"--export.overview-views is {self.overview_views}: needs 1 to 40.")
