"""The splat engine: one call, `rasterize`; everything that the paper renders is a choice of channels."""

from goc.raster.blend import BlendedViews, blend_views
from goc.raster.engine import NATIVE, Engine, choose_engine, cuda_flaw
from goc.raster.rasterize import median_splats, rasterize, rasterize_with_median, stacked
from goc.raster.render import centre_depths, plane_channels, plane_depth, render, render_labels
from goc.raster.surface import RenderedSurface, render_surface
from goc.raster.views import Views, joined_views, view_channels, views_of

__all__ = [
    "NATIVE",
    "BlendedViews",
    "Engine",
    "RenderedSurface",
    "Views",
    "blend_views",
    "centre_depths",
    "choose_engine",
    "cuda_flaw",
    "joined_views",
    "median_splats",
    "plane_channels",
    "plane_depth",
    "rasterize",
    "rasterize_with_median",
    "render",
    "render_labels",
    "render_surface",
    "stacked",
    "view_channels",
    "views_of",
]
