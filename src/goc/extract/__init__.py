"""Stage 3, views → meshes: TSDF fusion, evidence, clean-up (paper's supplement, "Mesh extraction")."""

from goc.extract.config import ExtractConfig
from goc.extract.fuse import fuse_scene
from goc.extract.objects import extract_objects
from goc.extract.rendered_views import rendered_views

__all__ = ["ExtractConfig", "extract_objects", "fuse_scene", "rendered_views"]
