"""The depth that losses see, from blended channels; by either definition."""

from typing import Literal

from jaxtyping import Float
from torch import Tensor

from goc.geometry.rays import pixel_rays
from goc.raster import centre_depths, plane_channels, rasterize
from goc.reconstruct.losses import RenderedDepth, expected_depth, planes_depth
from goc.scene.camera import Camera
from goc.scene.gaussians import Gaussians

DepthDefinition = Literal["plane", "expected"]


def geometry_channels(gaussians: Gaussians, camera: Camera, definition: DepthDefinition) -> Float[Tensor, "n g"]:
    """What to blend for a depth: four plane channels, or the depth of the centres."""
    if definition == "plane":
        return plane_channels(gaussians, camera)
    return centre_depths(gaussians, camera)[:, None]


def rendered_depth(geometry: Float[Tensor, "h w g"], alpha: Float[Tensor, "h w"], camera: Camera) -> RenderedDepth:
    """Depth of blended `geometry_channels`."""
    if geometry.shape[-1] == 1:
        return expected_depth(geometry[..., 0], alpha)
    return planes_depth(geometry, alpha, pixel_rays(camera))


def draw_depth(gaussians: Gaussians, camera: Camera, definition: DepthDefinition) -> RenderedDepth:
    """A view's depth and nothing else; differentiable."""
    return rendered_depth(*rasterize(gaussians, camera, geometry_channels(gaussians, camera, definition)), camera)
