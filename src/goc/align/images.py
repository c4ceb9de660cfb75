"""What alignment looks at: coarse images of each view without edges, and the points that it compares."""

import math
from dataclasses import dataclass, field

import numpy as np
import scipy.ndimage
import torch
from jaxtyping import Float, Float32, UInt8
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from goc import _native
from goc.geometry.native_camera import native_camera
from goc.geometry.normals import fitted_normals, fitting_radius
from goc.scene import Camera, Capture

_SIDE_PX = 320
"""Longer side of the coarse images: finer ones took longer and fitted no better."""
_BUDGET_BYTES = 400 * 2**20
_BYTES_A_PIXEL = 31
_JUMP = 0.05
"""Neighbouring pixels whose depths differ by this share are of two surfaces."""
_MARGIN_PX = 2
"""Pixels that near an edge are left out: sensors see it elsewhere than cameras do."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedView:
    """One view's coarse images."""

    camera: Camera
    """As given, resized, double precision."""
    depth: Float32[np.ndarray, "h w"]
    """z, scene units; NaN = none, or beside an edge."""
    normals: Float32[np.ndarray, "h w 3"]
    """Unit, camera axes; NaN = none."""
    image: UInt8[np.ndarray, "h w 3"]
    """sRGB."""
    shades: dict[float, Float32[np.ndarray, "h w"]] = field(default_factory=dict)
    """Blurred greys that were asked for, by their blur."""

    def with_pose(self, world_from_cam: Float[np.ndarray, "4 4"]) -> "_native.Camera":
        """Its camera elsewhere, as kernels take it."""
        pose = torch.from_numpy(world_from_cam)
        return native_camera(
            Camera(
                focal_px=self.camera.focal_px,
                centre_px=self.camera.centre_px,
                width=self.camera.width,
                height=self.camera.height,
                world_from_cam=pose,
            )
        )

    def shade(self, sigma_px: float, channel: int | None = None) -> Float32[np.ndarray, "h w"]:
        """One channel or the mean of all, 0 to 1, blurred so that it leads from further away.

        The blur is told in pixels of an image whose longer side has 320.
        """
        if channel is None:
            if sigma_px not in self.shades:
                self.shades[sigma_px] = _blurred(self.image @ np.full(3, 1 / 3, np.float32), sigma_px)
            return self.shades[sigma_px]
        return _blurred(self.image[..., channel].astype(np.float32), sigma_px)


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Pixels of a view with depth and normals, a regular grid of them."""

    pixels: tuple[np.ndarray, np.ndarray]
    """Rows and columns."""
    points: Float32[np.ndarray, "p 3"]
    """Camera axes, scene units."""
    normals: Float32[np.ndarray, "p 3"]

    def shown_with(self, grey: Float32[np.ndarray, "h w"]) -> "_native.Surface":
        """The points with what a grey image has there."""
        return _native.Surface(self.points, self.normals, grey[self.pixels])


def _blurred(levels: Float32[np.ndarray, "h w"], sigma_px: float) -> Float32[np.ndarray, "h w"]:
    sigma = sigma_px * max(levels.shape) / _SIDE_PX
    return scipy.ndimage.gaussian_filter(levels / np.float32(255.0), sigma, mode="nearest", truncate=3.0)


def least_shrink(capture: Capture) -> int:
    """By how much images have to be shrunk at least, so that those of all views fit into memory."""
    pixels = sum(camera.width * camera.height for camera in capture.cameras)
    return math.ceil(math.sqrt(pixels * _BYTES_A_PIXEL / _BUDGET_BYTES))


def coarse_view(capture: Capture, view: int, fewest: int = 1) -> AlignedView | None:
    """One view's images, at most 320 pixels wide and high, shrunk by `fewest` at least; None without depth."""
    frame = capture[view]
    if frame.depth is None:
        return None
    shrink = max(fewest, -(-max(frame.camera.width, frame.camera.height) // _SIDE_PX))
    width, height = frame.camera.width // shrink, frame.camera.height // shrink
    whole = (slice(0, height * shrink), slice(0, width * shrink))
    image = F.avg_pool2d(frame.image[whole].float().permute(2, 0, 1), shrink).round().to(torch.uint8)
    known = frame.depth > 0 if frame.valid is None else (frame.depth > 0) & frame.valid
    depth = _shrunk(torch.where(known, frame.depth, torch.nan)[whole], shrink)
    camera = Camera(
        focal_px=frame.camera.focal_px.double() / shrink,
        centre_px=frame.camera.centre_px.double() / shrink,
        width=width,
        height=height,
        world_from_cam=frame.camera.world_from_cam.double(),
    )
    single = camera.to(dtype=torch.float32)
    normals = fitted_normals(depth, single, fitting_radius(depth, single))
    normals = torch.where((normals.square().sum(-1, keepdim=True) > 0.5), normals, torch.nan)
    return AlignedView(
        camera=camera,
        depth=_without_edges(depth).numpy(),
        normals=normals.contiguous().numpy(),
        image=image.permute(1, 2, 0).contiguous().numpy(),
    )


def _shrunk(depth: Float[Tensor, "H W"], shrink: int) -> Float[Tensor, "h w"]:
    """Mean of each block of pixels; NaN where one has no depth."""
    return F.avg_pool2d(depth[None, None], shrink)[0, 0]


def _without_edges(depth: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    """Depth; NaN within two pixels of a jump."""
    near = -F.max_pool2d(-torch.where(depth.isnan(), torch.inf, depth)[None, None], 3, 1, 1)
    far = F.max_pool2d(torch.where(depth.isnan(), -torch.inf, depth)[None, None], 3, 1, 1)
    jump = (far - near > _JUMP * near) & near.isfinite() & far.isfinite()
    beside = F.max_pool2d(jump.float(), 2 * _MARGIN_PX + 1, 1, _MARGIN_PX)[0, 0] > 0
    return torch.where(beside, torch.nan, depth).contiguous()


def samples_of(view: AlignedView, across: int) -> Samples:
    """A grid of `across` pixels on the longer side, of those that have depth and a normal."""
    step = max(1, max(view.depth.shape) // across)
    rows, columns = np.mgrid[step // 2 : view.depth.shape[0] : step, step // 2 : view.depth.shape[1] : step]
    rows, columns = rows.reshape(-1), columns.reshape(-1)
    known = np.isfinite(view.depth[rows, columns]) & np.isfinite(view.normals[rows, columns]).all(-1)
    rows, columns = rows[known], columns[known]
    z = view.depth[rows, columns]
    focal, centre = view.camera.focal_px.numpy(), view.camera.centre_px.numpy()
    x, y = (columns + 0.5 - centre[0]) / focal[0] * z, (rows + 0.5 - centre[1]) / focal[1] * z
    points = np.stack([x, y, z], -1).astype(np.float32)
    return Samples(pixels=(rows, columns), points=points, normals=np.ascontiguousarray(view.normals[rows, columns]))
