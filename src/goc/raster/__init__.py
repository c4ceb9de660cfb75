"""The splat engine: one call, `rasterize`; everything that the paper renders is a choice of channels."""

from goc.raster.blend import BlendedView, blend_view
from goc.raster.engine import CPU, NATIVE, Engine, EngineName, choose_engine, cuda_flaw, working_device
from goc.raster.rasterize import median_splats, rasterize, visible_splats
from goc.raster.render import centre_depths, median_depth, plane_channels, plane_depth, render, render_labels
from goc.raster.views import Views, joined_views, view_channels, views_of

__all__ = [
    "CPU",
    "NATIVE",
    "BlendedView",
    "Engine",
    "EngineName",
    "Views",
    "blend_view",
    "centre_depths",
    "choose_engine",
    "cuda_flaw",
    "joined_views",
    "median_depth",
    "median_splats",
    "plane_channels",
    "plane_depth",
    "rasterize",
    "render",
    "render_labels",
    "view_channels",
    "views_of",
    "visible_splats",
    "working_device",
]
