"""The two steps from a stored raster to a camera's: undistortion, then scaling. Each may be left out.

Both work in floating point, and nothing is rounded between them.
"""

from typing import Literal

from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from goc.capture.distortion import sampling_grid
from goc.capture.source import Lens
from goc.scene import Camera

Sampling = Literal["bilinear", "nearest"]
"""bilinear: colour. nearest: depth, ids and normals, of which neighbours are never mixed."""


def undistorted(planes: Float[Tensor, "c H W"], lens: Lens, sampling: Sampling) -> Float[Tensor, "c h w"]:
    """Planes as a pinhole with the lens's focal lengths sees them, without borders that no stored pixel covers.

    Args:
        planes: of any resolution, registered to the lens's image.
        lens: where it is a pinhole already, the planes are returned as they are.
        sampling: how values between pixels are found.

    Returns:
        The raster of `kept_box(lens)`.
    """
    if lens.is_pinhole:
        return planes
    grid = sampling_grid(lens)[None]
    return F.grid_sample(planes[None], grid, mode=sampling, padding_mode="border", align_corners=False)[0]


def resized(planes: Float[Tensor, "c H W"], camera: Camera, sampling: Sampling) -> Float[Tensor, "c h w"]:
    """Planes scaled to the camera's width and height; as they are where they have them."""
    size = (camera.height, camera.width)
    if planes.shape[1:] == size:
        return planes
    if sampling == "nearest":
        return F.interpolate(planes[None], size, mode="nearest-exact")[0]
    return F.interpolate(planes[None], size, mode="bilinear", antialias=True, align_corners=False)[0]
