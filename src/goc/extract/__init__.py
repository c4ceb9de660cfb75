"""Stage 3, views → meshes: TSDF fusion, evidence, clean-up (paper's supplement, "Mesh extraction")."""

from goc.extract.agreement import views_noise
from goc.extract.config import ExtractConfig, WorldConfig
from goc.extract.fuse import fuse_scene
from goc.extract.measured_views import DepthError, MeasuredViews, measured_views
from goc.extract.objects import extract_objects
from goc.extract.rendered_views import rendered_views
from goc.extract.stage import extract_scene
from goc.extract.world import find_world

__all__ = [
    "DepthError",
    "ExtractConfig",
    "MeasuredViews",
    "WorldConfig",
    "extract_objects",
    "extract_scene",
    "find_world",
    "fuse_scene",
    "measured_views",
    "rendered_views",
    "views_noise",
]
