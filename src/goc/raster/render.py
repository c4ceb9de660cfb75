"""`render`: everything worth looking at in one view, without gradients."""

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc.geometry.harmonics import colours_towards
from goc.geometry.rotations import rotated
from goc.raster.rasterize import rasterize
from goc.scene.camera import Camera
from goc.scene.capture import UNLABELLED
from goc.scene.gaussians import Gaussians
from goc.scene.rendering import Rendering

_LABELS_A_PASS = 24


def centre_depths(gaussians: Gaussians, camera: Camera) -> Float[Tensor, "n"]:
    """Z of the splats' centres, camera axes; differentiable."""
    row = camera.cam_from_world[2]
    return gaussians.means @ row[:3] + row[3]


def plane_channels(gaussians: Gaussians, camera: Camera) -> Float[Tensor, "n 4"]:
    """Normal (camera axes, facing the camera) and plane distance n·mean of each splat; differentiable.

    Blended to N and D, depth(p) = D(p) / (N(p)·K⁻¹p) is the depth of the splats' planes: free of the bias that the
    centre's depth has on a slanted splat (the unbiased depth of Chen et al. 2024).
    """
    view = camera.cam_from_world
    centres = camera.in_camera(gaussians.means)
    thinnest = torch.nn.functional.one_hot(gaussians.log_scales.argmin(-1), 3).to(gaussians.means.dtype)
    normals = rotated(gaussians.quats, thinnest) @ view[:3, :3].T
    distances = (normals * centres).sum(-1, keepdim=True)
    # A plane before the camera that faces it has n·centre < 0.
    sign = torch.where(distances > 0, -1.0, 1.0)
    return torch.cat([normals * sign, distances * sign], -1)


def plane_depth(blended: Float[Tensor, "h w 4"], camera: Camera) -> Float[Tensor, "h w"]:
    """depth(p) = D(p) / (N(p)·K⁻¹p) of blended plane_channels; NaN where no plane is met in front of the camera."""
    slope = (blended[..., :3] * camera.rays()).sum(-1)
    depth = blended[..., 3] / torch.where(slope < -1e-6, slope, torch.nan)
    return torch.where(depth > 0, depth, torch.nan)


@torch.no_grad()
def render(gaussians: Gaussians, camera: Camera) -> Rendering:
    """Colour, alpha, both depths and normals of one view, where the splats are."""
    camera = camera.to(gaussians.means.device)
    colours = colours_towards(gaussians.sh, gaussians.means, camera.position)
    z, planes = centre_depths(gaussians, camera)[:, None], plane_channels(gaussians, camera)
    image, alpha = rasterize(gaussians, camera, torch.cat([colours, z, planes], -1))
    return Rendering(
        colour=image[..., :3].clamp(0.0, 1.0),
        alpha=alpha,
        depth=image[..., 3] / alpha.clamp_min(1e-10),
        plane_depth=plane_depth(image[..., 4:], camera),
        normals=torch.nn.functional.normalize(image[..., 4:7], dim=-1),
    )


@torch.no_grad()
def render_labels(
    gaussians: Gaussians, labels: Int16[Tensor, "n"], camera: Camera, min_alpha: float = 0.5
) -> Int16[Tensor, "h w"]:
    """Id that most of each pixel's weight belongs to; UNLABELLED where alpha is below `min_alpha`.

    Splats without a label (UNLABELLED) take part: where they have most weight, the pixel has no id.
    """
    names = torch.unique(labels)
    size, device = (camera.height, camera.width), labels.device
    best = torch.full(size, -1.0, device=device)
    ids = torch.full(size, UNLABELLED, dtype=torch.int16, device=device)
    alpha = torch.zeros(size, device=device)
    for chunk in names.split(_LABELS_A_PASS):
        image, alpha = rasterize(gaussians, camera, (labels[:, None] == chunk).float())
        weight, winner = image.max(-1)
        ids = torch.where(weight > best, chunk[winner], ids)
        best = torch.maximum(weight, best)
    return torch.where(alpha >= min_alpha, ids, UNLABELLED)
