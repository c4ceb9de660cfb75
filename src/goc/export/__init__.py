"""Stage 6, Scene → files that a tool opens."""

from goc.export.config import ExportConfig
from goc.export.writers import WRITERS, export_scene

__all__ = ["WRITERS", "ExportConfig", "export_scene"]
