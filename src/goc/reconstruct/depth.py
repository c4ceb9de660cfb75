"""A view's depth and nothing else."""

from dataclasses import replace
from typing import Literal

from goc.raster import Engine, Views, centre_depths, plane_channels, view_channels
from goc.reconstruct.losses import RenderedDepth, rendered_depth
from goc.scene.gaussians import Gaussians

DepthDefinition = Literal["plane", "expected"]


def draw_depth(gaussians: Gaussians, views: Views, definition: DepthDefinition, engine: Engine) -> RenderedDepth:
    """Depth of one view, by either definition; differentiable."""
    planes = definition == "plane"
    if engine.fused:
        (camera,) = views.cameras
        channels = plane_channels(gaussians, camera) if planes else centre_depths(gaussians, camera)[:, None]
        geometry, alpha = engine.blend(gaussians, views, channels[None])
    else:
        channels = view_channels(replace(gaussians, identity=None), views, planes)[..., 3 : 7 if planes else 4]
        geometry, alpha = engine.blend(gaussians, views, channels)
    return rendered_depth(geometry.permute(0, 3, 1, 2), alpha, views)
