"""The depth that losses see, from blended channels; by either definition."""

from typing import Literal

from jaxtyping import Float
from torch import Tensor

from goc.raster import centre_depths, plane_channels, rasterize
from goc.reconstruct.losses import RenderedDepth, expected_depth, planes_depth
from goc.scene.camera import Camera
from goc.scene.gaussians import Gaussians

DepthDefinition = Literal["plane", "expected"]


def rendered_depth(geometry: Float[Tensor, "g h w"], alpha: Float[Tensor, "h w"], camera: Camera) -> RenderedDepth:
    """Depth of four blended plane channels, or of one blended centre depth."""
    if geometry.shape[0] == 1:
        return expected_depth(geometry[0], alpha)
    return planes_depth(geometry, alpha, camera)


def draw_depth(gaussians: Gaussians, camera: Camera, definition: DepthDefinition) -> RenderedDepth:
    """A view's depth and nothing else; differentiable."""
    planes = definition == "plane"
    channels = plane_channels(gaussians, camera) if planes else centre_depths(gaussians, camera)[:, None]
    geometry, alpha = rasterize(gaussians, camera, channels)
    return rendered_depth(geometry.permute(2, 0, 1), alpha, camera)
