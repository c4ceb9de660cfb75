"""Stage 1c, Capture → Capture: cameras and photographs as the views themselves say, where these do not fit."""

from goc.align.config import AlignConfig
from goc.align.stage import align

__all__ = ["AlignConfig", "align"]
