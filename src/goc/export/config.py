"""Settings of stage 6."""

from dataclasses import dataclass
from typing import Annotated

from goc.settings import Range, Settings


@dataclass(frozen=True, kw_only=True)
class ExportConfig(Settings):
    """What is written, and where nothing may be overwritten."""

    overwrite: bool = False
    """Replace what an earlier run wrote into the same folder; other files there stay."""
    overview_views: Annotated[int, Range(least=1, most=40)] = 3
    """Views shown in overview.png."""
