"""Pixels of one view projected into another by rendered depth, and both losses of the pair, in PyTorch."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from goc.raster import Views
from goc.reconstruct.losses.depth import RenderedDepth, surface_shown

_C1, _C2 = 1e-4, 9e-4
"""Stabilising constants of SSIM, (0.01)² and (0.03)²."""
_MAX_ERROR_PX = 1.0
"""Reprojection error, pixels, from which on two depths are taken for two surfaces."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Photograph:
    """A posed image with colours from 0 to 1."""

    views: Views
    """Its camera, as one view."""
    image: Float[Tensor, "3 h w"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Warp:
    """Where the 3D point of each of p pixels projects into the neighbour, and the neighbour's own depth there."""

    places: Float[Tensor, "p 2"]
    """Pixel coordinates in the neighbour's photograph."""
    z: Float[Tensor, "p"]
    """z of the point in the neighbour's camera, scene units."""
    inverse: Float[Tensor, "p"]
    """1 / z of the surface that the neighbour shows there."""
    known: Bool[Tensor, "p"]
    """The pixel shows a surface, and so does the neighbour where it lands."""
    smooth: Bool[Tensor, "p"]
    """Known, and the four depths that are interpolated there belong to one surface."""


def warped(
    depth: RenderedDepth,
    here: Views,
    there: Views,
    inverse_depth: Float[Tensor, "i j"],
    stride: int,
    tolerance: float,
) -> Warp:
    """Project every pixel of one view into a neighbour by its rendered depth.

    Args:
        depth: rendered depth of the view.
        here: the view; one camera.
        there: the neighbour; one camera.
        inverse_depth: 1/z that the neighbour shows at every `stride`-th pixel; 0 = none.
        stride: an odd number of pixels.
        tolerance: depths within this share of each other are one surface.
    """
    shown = surface_shown(depth)[0]
    z = torch.where(shown, depth.numerator[0], 1.0) / torch.where(shown, depth.denominator[0], 1.0)
    shown, z = shown.reshape(-1), z.reshape(-1)
    there_from_here = (_rigid(there) @ _inverse(_rigid(here))).to(z.dtype)
    points = (_rays(here).to(z.dtype) * z[:, None]) @ there_from_here[:3, :3].T + there_from_here[:3, 3]
    ahead = points[:, 2] > 0
    there_z = torch.where(ahead, points[:, 2], 1.0)
    places = _projected(points, there_z, there)
    found, inside, low, high = _sampled(inverse_depth[None], places / stride)
    known = shown & ahead & inside & (low[0] > 0)
    smooth = known & (high[0] <= (1 + tolerance) * low[0])
    return Warp(places=places, z=there_z, inverse=found[0], known=known, smooth=smooth)


def photometric_error(warp: Warp, here: Photograph, there: Photograph, tolerance: float) -> Float[Tensor, ""]:
    """Mean of 0.85·(1 - SSIM)/2 + 0.15·|C - C̃| over pixels whose 3×3 block is in the neighbour and not hidden there."""
    size = here.image.shape[1:]
    colours, inside, _, _ = _sampled(there.image, warp.places)
    # The neighbour's surface only decides what is hidden, so no gradient reaches it.
    seen = (warp.known & inside & (warp.z * warp.inverse.detach() <= 1 + tolerance)).view(size)
    x = torch.where(seen, colours.view(3, *size), 0.0)[:, None]
    y = torch.where(seen, here.image, 0.0)[:, None]
    mx, my = _block_mean(x), _block_mean(y)
    xx, yy, xy = _block_mean(x * x) - mx * mx, _block_mean(y * y) - my * my, _block_mean(x * y) - mx * my
    ssim = ((2 * mx * my + _C1) * (2 * xy + _C2)) / ((mx * mx + my * my + _C1) * (xx + yy + _C2))
    terms = 0.85 * (1 - ssim) / 2 + 0.15 * (x - y)[..., 1:-1, 1:-1].abs()
    whole = -F.max_pool2d(-seen[None, None].to(x.dtype), 3, 1)[0, 0] > 0.5
    return _mean_of_many(terms[:, 0].mean(0), whole, seen.numel())


def geometric_error(warp: Warp, here: Views, there: Views) -> Float[Tensor, ""]:
    """Mean of exp(-e)·e over pixels that land on a surface; e is the distance in pixels after going there and back.

    Errors of a pixel or more count 0. The weight exp(-e) has no gradient.
    """
    far = 1.0 / torch.where(warp.smooth, warp.inverse, 1.0)
    across = (warp.places - there.centre_px[0]) / there.focal_px[0]
    points = torch.cat([across * far[:, None], far[:, None]], -1)
    here_from_there = (_rigid(here) @ _inverse(_rigid(there))).to(far.dtype)
    returned = points @ here_from_there[:3, :3].T + here_from_there[:3, 3]
    met = warp.smooth & (returned[:, 2] > 0)
    rays = _rays(here).to(far.dtype)
    returned = torch.where(met[:, None], returned, rays)
    start = _projected(rays, far.new_ones(()), here)
    error = (_projected(returned, returned[:, 2], here) - start).norm(dim=-1)
    terms = torch.where(met & (error < _MAX_ERROR_PX), torch.exp(-error.detach()) * error, 0.0)
    return _mean_of_many(terms, warp.smooth, terms.numel())


def _mean_of_many(values: Float[Tensor, "*s"], known: Bool[Tensor, "*s"], pixels: int) -> Float[Tensor, ""]:
    """Sum of the known values over their number, or over a quarter of the pixels if there are fewer known."""
    return torch.where(known, values, 0.0).sum() / known.sum().clamp_min(max(1, pixels // 4))


def _block_mean(image: Float[Tensor, "k 1 h w"]) -> Float[Tensor, "k 1 i j"]:
    return F.avg_pool2d(image, 3, 1)


def _sampled(
    image: Float[Tensor, "k i j"], places: Float[Tensor, "p 2"]
) -> tuple[Float[Tensor, "k p"], Bool[Tensor, "p"], Float[Tensor, "k p"], Float[Tensor, "k p"]]:
    """Bilinear values of an image at places, whether these are inside, and the least and largest of four corners."""
    height, width = image.shape[1:]
    u, v = places[:, 0] - 0.5, places[:, 1] - 0.5
    inside = (u >= 0) & (v >= 0) & (u < width - 1) & (v < height - 1)
    u, v = torch.where(inside, u, 0.0), torch.where(inside, v, 0.0)
    x, y = u.detach().floor().long(), v.detach().floor().long()
    first = y * width + x
    flat = image.flatten(1)
    step_x, step_y = min(1, width - 1), width * min(1, height - 1)
    corners = [flat[:, first + across + down] for down in (0, step_y) for across in (0, step_x)]
    s, t = u - x, v - y
    value = (1 - t) * ((1 - s) * corners[0] + s * corners[1]) + t * ((1 - s) * corners[2] + s * corners[3])
    stacked = torch.stack(corners).detach()
    return value, inside, stacked.amin(0), stacked.amax(0)


def _projected(points: Float[Tensor, "p 3"], z: Float[Tensor, "*p"], views: Views) -> Float[Tensor, "p 2"]:
    return points[:, :2] / z[..., None] * views.focal_px[0] + views.centre_px[0]


def _rays(views: Views) -> Float[Tensor, "p 3"]:
    x, y = (side[0].expand(views.height, views.width) for side in views.rays)
    return torch.stack([x, y, torch.ones_like(x)], -1).view(-1, 3)


def _rigid(views: Views) -> Float[Tensor, "4 4"]:
    return views.cam_from_world[0].double()


def _inverse(rigid: Float[Tensor, "4 4"]) -> Float[Tensor, "4 4"]:
    """Invert a rigid transform by transposing, because a solver would wait for the device."""
    turned = rigid[:3, :3].T
    top = torch.cat([turned, -turned @ rigid[:3, 3:]], 1)
    return torch.cat([top, rigid[3:]])
