"""The splat engine: one call, `rasterize`; everything that the paper renders is a choice of channels."""

from goc.raster.blend import BlendedView, blend_view
from goc.raster.rasterize import median_splats, rasterize, visible_splats
from goc.raster.render import centre_depths, median_depth, plane_channels, plane_depth, render, render_labels

__all__ = [
    "BlendedView",
    "blend_view",
    "centre_depths",
    "median_depth",
    "median_splats",
    "plane_channels",
    "plane_depth",
    "rasterize",
    "render",
    "render_labels",
    "visible_splats",
]
