"""From a stored raster to a camera's: colours mixed, depth, ids and normals picked. Nothing is rounded on the way."""

import torch
from jaxtyping import Float, Shaped
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from goc.capture.distortion import Pinhole, pinhole_of, sampling_grid
from goc.capture.source import Lens

_FINER = 2
"""Undistortion works at this many pixels of the stored image for one of the view, across and down, or more."""


def coloured(planes: Shaped[Tensor, "c H W"], lens: Lens, view: Pinhole) -> Float[Tensor, "c h w"]:
    """Planes as a pinhole view sees them: averaged where it is coarser than the stored image.

    Args:
        planes: of any resolution, registered to the lens's image.
        lens: of the image.
        view: `pinhole_of(lens)`, at any resolution.
    """
    if lens.is_pinhole:
        return _averaged(planes.float(), view.width, view.height)
    whole = pinhole_of(lens)
    shrink = int(max(1, min(whole.width / view.width, whole.height / view.height) / _FINER))
    fine = whole if shrink == 1 else view.resized(whole.width // shrink, whole.height // shrink)
    stored = _averaged(planes.float(), planes.shape[2] // shrink, planes.shape[1] // shrink)
    grid = sampling_grid(lens, fine)[None]
    seen = F.grid_sample(stored[None], grid, mode="bilinear", padding_mode="border", align_corners=False)[0]
    return _averaged(seen, view.width, view.height)


def nearest(
    planes: Float[Tensor, "c H W"], lens: Lens, view: Pinhole, outside: float = torch.nan
) -> Float[Tensor, "c h w"]:
    """Planes as a pinhole view sees them, each of its pixels the one stored pixel at its centre.

    Args:
        planes: of any resolution, registered to the lens's image.
        lens: of the planes; where it is a pinhole and shares the view's field, only the resolution changes.
        view: any pinhole along the lens's axis (or turn).
        outside: value of pixels that the lens does not see.
    """
    if lens.is_pinhole and _shares_field(lens, view):
        size = (view.height, view.width)
        return planes if planes.shape[1:] == size else F.interpolate(planes[None], size, mode="nearest-exact")[0]
    grid = sampling_grid(lens, view)
    seen = F.grid_sample(planes[None], grid[None], mode="nearest", padding_mode="border", align_corners=False)[0]
    return torch.where((grid.abs() <= 1).all(-1), seen, outside)


def _averaged(planes: Float[Tensor, "c H W"], width: int, height: int) -> Float[Tensor, "c h w"]:
    if planes.shape[1:] == (height, width):
        return planes
    return F.interpolate(planes[None], (height, width), mode="bilinear", antialias=True, align_corners=False)[0]


def _shares_field(lens: Lens, view: Pinhole) -> bool:
    """Whether a pinhole lens and a view differ in nothing but resolution, to a hundredth of a pixel."""
    same = lens.resized(view.width, view.height)
    pairs = zip((*same.focal_px, *same.centre_px), (*view.focal_px, *view.centre_px), strict=True)
    return all(abs(one - other) < 0.01 for one, other in pairs)
