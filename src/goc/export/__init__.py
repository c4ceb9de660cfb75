"""Stage 5, SceneAssets → files that a tool opens."""

from goc.export.config import ExportConfig
from goc.export.scene import export_scene

__all__ = ["ExportConfig", "export_scene"]
