"""L_pho and L_geo by their definitions, any dtype, gradients by autograd."""

from dataclasses import dataclass

import torch
from torch import Tensor

from goc.geometry.rays import pixel_rays
from goc.scene import Camera


@dataclass(frozen=True, eq=False)
class Pair:
    """A view and its neighbour."""

    camera: Camera
    image: Tensor  # (h w 3), 0 to 1
    neighbour_camera: Camera
    neighbour_image: Tensor
    stride: int = 1


def sample(image: Tensor, places: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Bilinear values (p c) of an image (h w c) at pixels (p 2), whether they are inside, least and largest corner."""
    h, w = image.shape[:2]
    u, v = places[:, 0] - 0.5, places[:, 1] - 0.5
    inside = (u >= 0) & (v >= 0) & (u < w - 1) & (v < h - 1)
    x, y = u.detach().floor().clamp(0, w - 2).long(), v.detach().floor().clamp(0, h - 2).long()
    fx, fy = (u - x)[:, None], (v - y)[:, None]
    corners = torch.stack([image[y, x], image[y, x + 1], image[y + 1, x], image[y + 1, x + 1]])
    value = (1 - fy) * ((1 - fx) * corners[0] + fx * corners[1]) + fy * ((1 - fx) * corners[2] + fx * corners[3])
    return value, inside, corners.amin(0), corners.amax(0)


def project(points: Tensor, camera: Camera) -> Tensor:
    return points[:, :2] / points[:, 2:] * camera.focal_px.to(points) + camera.centre_px.to(points)


def carried(depth: Tensor, pair: Pair) -> tuple[Tensor, Tensor]:
    """Points of the view's pixels in the neighbour's camera axes, and their pixels there."""
    rays = pixel_rays(pair.camera).to(depth).reshape(-1, 3)
    to = pair.neighbour_camera.cam_from_world.to(depth) @ pair.camera.world_from_cam.to(depth)
    points = (rays * depth.reshape(-1, 1)) @ to[:3, :3].T + to[:3, 3]
    return points, project(points, pair.neighbour_camera)


def visible(depth: Tensor, alpha: Tensor, inverse: Tensor, pair: Pair, tolerance: float) -> dict[str, Tensor]:
    """What the neighbour shows where each pixel's point lands."""
    points, places = carried(depth, pair)
    found, inside, low, high = sample(inverse[..., None], places / pair.stride)
    known = inside & (points[:, 2] > 0) & (low[:, 0] > 0) & (alpha.reshape(-1) > 0.5) & (depth.reshape(-1) > 0)
    return {
        "places": places,
        "inverse": found[:, 0],
        "shown": known & (points[:, 2] * found[:, 0] <= 1 + tolerance),
        "smooth": known & (high[:, 0] <= (1 + tolerance) * low[:, 0]),
    }


def warped(depth: Tensor, alpha: Tensor, inverse: Tensor, pair: Pair, tolerance: float) -> tuple[Tensor, Tensor]:
    """C̃ (h w 3) and where it is known (h w)."""
    seen = visible(depth, alpha, inverse, pair, tolerance)
    colours, inside, _, _ = sample(pair.neighbour_image.to(depth), seen["places"])
    known = seen["shown"] & inside
    return torch.where(known[:, None], colours, 0.0).reshape(*depth.shape, 3), known.reshape(depth.shape)


def photometric(depth: Tensor, alpha: Tensor, inverse: Tensor, pair: Pair, tolerance: float) -> Tensor:
    """Eq. (5) over pixels whose 3×3 block is known."""
    x, known = warped(depth, alpha, inverse, pair, tolerance)
    y = torch.where(known[..., None], pair.image.to(depth), 0.0)
    x, y = x.permute(2, 0, 1)[:, None], y.permute(2, 0, 1)[:, None]

    def mean(values: Tensor) -> Tensor:
        return torch.nn.functional.avg_pool2d(values, 3, 1)

    mx, my = mean(x), mean(y)
    xx, yy, xy = mean(x * x) - mx * mx, mean(y * y) - my * my, mean(x * y) - mx * my
    ssim = ((2 * mx * my + 1e-4) * (2 * xy + 9e-4)) / ((mx * mx + my * my + 1e-4) * (xx + yy + 9e-4))
    whole = mean(known[None, None].to(depth))[0, 0] > 1 - 1e-6
    terms = 0.85 * (1 - ssim) / 2 + 0.15 * (x - y)[..., 1:-1, 1:-1].abs()
    return terms[:, 0].mean(0)[whole].sum() / max(whole.sum().item(), depth.numel() // 4)


def geometric(depth: Tensor, alpha: Tensor, inverse: Tensor, pair: Pair, tolerance: float) -> Tensor:
    """Mean of exp(-e)·e, or 0 from one pixel on, over pixels that land on a surface."""
    seen = visible(depth, alpha, inverse, pair, tolerance)
    there = pair.neighbour_camera
    far = 1.0 / torch.where(seen["smooth"], seen["inverse"], 1.0)
    ray = torch.cat(
        [(seen["places"] - there.centre_px.to(depth)) / there.focal_px.to(depth), torch.ones_like(far)[:, None]], -1
    )
    back = pair.camera.cam_from_world.to(depth) @ there.world_from_cam.to(depth)
    returned = (ray * far[:, None]) @ back[:3, :3].T + back[:3, 3]
    start = project(pixel_rays(pair.camera).to(depth).reshape(-1, 3), pair.camera)
    error = (project(returned, pair.camera) - start)[seen["smooth"]].norm(dim=-1)
    error = error[(error < 1.0) & (returned[seen["smooth"], 2] > 0)]
    return (torch.exp(-error.detach()) * error).sum() / max(seen["smooth"].sum().item(), depth.numel() // 4)
