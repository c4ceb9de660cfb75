"""Stage 3, views → meshes: TSDF fusion, evidence, clean-up (paper's supplement, "Mesh extraction")."""

from goc.extract.config import ExtractConfig, WorldConfig
from goc.extract.fuse import fuse_scene
from goc.extract.objects import extract_objects
from goc.extract.rendered_views import rendered_views
from goc.extract.stage import extract_scene

__all__ = ["ExtractConfig", "WorldConfig", "extract_objects", "extract_scene", "fuse_scene", "rendered_views"]
