"""`render_surface`: what meshing asks of a view, from one look at its splats."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc.raster.rasterize import rasterize_with_median
from goc.raster.render import centre_depths, plane_channels, plane_depth, render_labels
from goc.scene.camera import Camera
from goc.scene.capture import UNLABELLED
from goc.scene.gaussians import Gaussians

_LABELS = 24
"""More ids than these are drawn by themselves, some at a time: all at once would take much memory."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedSurface:
    """Images of one view, of the camera's height and width, where the splats are."""

    alpha: Float[Tensor, "h w"]
    mixed: Float[Tensor, "h w"]
    """Standard deviation of z over the splats that a pixel shows, as a share of their mean: how much it mixes."""
    plane_depth: Float[Tensor, "h w"]
    """z where the ray meets the blended splat plane; NaN where there is none."""
    median_depth: Float[Tensor, "h w"]
    """z where the ray meets the plane of the splat that makes it half opaque; NaN where none does. It lies on one
    surface even where a pixel shows two: blended depths fly between them."""
    ids: Int16[Tensor, "h w"] | None
    """Id that most of each pixel's weight belongs to, as `render_labels` says."""


@torch.no_grad()
def render_surface(
    gaussians: Gaussians, labels: Int16[Tensor, "n"] | None, camera: Camera, min_alpha: float = 0.5
) -> RenderedSurface:
    """Both depths of a view, how much each pixel mixes, and its ids.

    Args:
        gaussians: the splats.
        labels: of the splats; None: no ids are wanted.
        camera: the view.
        min_alpha: below, a pixel has no id.
    """
    camera = camera.to(gaussians.means.device)
    z, planes = centre_depths(gaussians, camera), plane_channels(gaussians, camera)
    names = torch.unique(labels) if labels is not None else planes.new_empty(0, dtype=torch.int16)
    together = 0 < len(names) <= _LABELS
    shares = (labels[:, None] == names).float() if together else planes[:, :0]
    channels = torch.cat([torch.stack([z, z.square()], -1), planes, shares], -1)
    image, alpha, median = rasterize_with_median(gaussians, camera, channels)
    depth, square = (image[..., :2] / alpha.clamp_min(1e-10)[..., None]).unbind(-1)
    if together:
        ids = torch.where(alpha >= min_alpha, names[image[..., 6:].max(-1).indices], UNLABELLED)
    else:
        ids = None if labels is None else render_labels(gaussians, labels, camera, min_alpha)
    return RenderedSurface(
        alpha=alpha,
        mixed=(square - depth.square()).clamp_min(0.0).sqrt() / depth,
        plane_depth=plane_depth(image[..., 2:6], camera),
        median_depth=torch.where(median >= 0, plane_depth(planes[median.clamp_min(0).long()], camera), torch.nan),
        ids=ids,
    )
