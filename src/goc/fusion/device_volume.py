"""Fusion in plain PyTorch, on any device: the sums of `Volume`, all voxels in view at once."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int16, Int64, UInt8
from torch import Tensor

from goc import _native
from goc.fusion.depth_views import DepthView
from goc.fusion.volume import BLOCK, DISTANCE, EMPTY, OTHER, RED, VIEWS, WEIGHT, BlockGrid, Volume
from goc.scene.camera import Camera

_BLOCKS_AT_ONCE = 4096
"""Two million voxels, of which some 30 numbers each are in memory at once: 250 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DeviceDepth:
    """A `DepthView` on a device, its images flat."""

    depth: Float[Tensor, "p"]
    slope: Float[Tensor, "p"]
    ids: Int16[Tensor, "p"] | None
    colours: UInt8[Tensor, "p 3"] | None
    camera: Camera
    """Its numbers stay on the CPU."""


def fuse_views(
    grids: Sequence[BlockGrid], wanted: Sequence[int | None], views: Iterable[DepthView], device: torch.device
) -> list[Volume]:
    """Fuse all views onto each grid, where only pixels of the wanted id are surface (None: all).

    On the processor in native calls, elsewhere in PyTorch; what comes out is on the processor.
    """
    if device.type == "cpu":
        volumes = [Volume(grid) for grid in grids]
        for view in views:
            for volume, own in zip(volumes, wanted, strict=True):
                volume.add(view, own)
        return volumes
    sums = [DeviceVolume(grid, device) for grid in grids]
    for view in views:
        uploaded = on_device(view, device)
        for volume, own in zip(sums, wanted, strict=True):
            volume.add(uploaded, own)
    return [volume.finished() for volume in sums]


def on_device(view: DepthView, device: torch.device) -> DeviceDepth:
    """Copy a view's images."""
    return DeviceDepth(
        depth=torch.from_numpy(view.depth).to(device).reshape(-1),
        slope=torch.from_numpy(view.slope).to(device).reshape(-1),
        ids=None if view.ids is None else torch.from_numpy(view.ids).to(device).reshape(-1),
        colours=None if view.colours is None else torch.from_numpy(view.colours).to(device).reshape(-1, 3),
        camera=view.camera,
    )


class DeviceVolume:
    """As `Volume`; native/fuse.cpp is its twin in the tests."""

    def __init__(self, grid: BlockGrid, device: torch.device) -> None:
        """Start with all sums 0."""
        self._block_grid = grid
        self._corners = torch.from_numpy(grid.blocks.astype(np.float64) * BLOCK).to(device)
        steps = torch.arange(BLOCK, device=device)
        self._offsets = torch.cartesian_prod(steps, steps, steps)
        self._sums = torch.zeros(_native.FUSE_SUMS, len(grid.blocks) * BLOCK**3, device=device)

    def finished(self) -> Volume:
        """The sums on the processor."""
        volume = Volume(self._block_grid)
        volume.sums[:] = self._sums.cpu().numpy().reshape(volume.sums.shape)
        return volume

    def add(self, view: DeviceDepth, wanted: int | None) -> None:
        """Fuse one view; only pixels of id `wanted` are surface, None takes all. Rays that pass vote empty."""
        pose = view.camera.cam_from_world.double().numpy()[:3]
        axes = pose[:, :3] * self._block_grid.voxel
        base = pose[:, :3] @ self._block_grid.origin + pose[:, 3]
        for first in range(0, len(self._corners), _BLOCKS_AT_ONCE):
            corners = self._corners[first : first + _BLOCKS_AT_ONCE]
            # In double: it is where the increments of a whole block start.
            starts = (corners @ self._like(axes.T, corners) + self._like(base, corners)).float()
            steps = self._like(axes.T, starts)
            met = torch.nonzero(self._seen(view, starts + steps.sum(0) * (0.5 * (BLOCK - 1))))[:, 0]
            points = starts[met, None] + self._offsets.to(steps) @ steps
            voxels = (first + met)[:, None] * BLOCK**3 + torch.arange(BLOCK**3, device=met.device)
            self._vote(view, wanted, points.reshape(-1, 3), voxels.reshape(-1))

    @staticmethod
    def _like(numbers: np.ndarray, tensor: Tensor) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(numbers)).to(tensor)

    def _seen(self, view: DeviceDepth, middles: Float[Tensor, "b 3"]) -> Tensor:
        """Whether any point of a block's ball could be in the image."""
        (fx, fy), (cx, cy) = view.camera.focal_px.tolist(), view.camera.centre_px.tolist()
        radius = self._block_grid.voxel * BLOCK * 0.87
        x, y, z = middles.unbind(-1)
        met = z >= -radius
        sides = ((x, fx, view.camera.width - cx), (-x, fx, cx), (y, fy, view.camera.height - cy), (-y, fy, cy))
        for along, focal, edge in sides:
            met = met & (focal * along - edge * z <= radius * (focal**2 + edge**2) ** 0.5)
        return met

    def _vote(
        self, view: DeviceDepth, wanted: int | None, points: Float[Tensor, "m 3"], voxels: Int64[Tensor, "m"]
    ) -> None:
        """Add what the pixel that each voxel falls into says of it."""
        voxel, truncation = self._block_grid.voxel, self._block_grid.truncation
        (fx, fy), (cx, cy) = view.camera.focal_px.tolist(), view.camera.centre_px.tolist()
        scale = 1.0 / points[:, 2]
        u, v = fx * (points[:, 0] * scale) + cx, fy * (points[:, 1] * scale) + cy
        inside = (points[:, 2] > 0) & (u >= 0) & (v >= 0) & (u < view.camera.width) & (v < view.camera.height)
        rows = torch.nonzero(inside)[:, 0]
        u, v, z, voxels = u[rows], v[rows], points[rows, 2], voxels[rows]
        pixel = v.long() * view.camera.width + u.long()
        # Further behind along the ray, an oblique tangent plane would speak for places that its surface never gets to.
        rows = torch.nonzero(~view.slope[pixel].isnan() & (z - view.depth[pixel] <= 2.0 * truncation))[:, 0]
        u, v, z, voxels, pixel = u[rows], v[rows], z[rows], voxels[rows], pixel[rows]
        slope, ids = view.slope[pixel], None if wanted is None or view.ids is None else view.ids[pixel]
        depth = _depth_at(view, u, v, pixel, 2.0 * truncation, ids)
        distance, weight = (depth - z) * slope, slope / (z * z)
        own = torch.ones_like(z, dtype=torch.bool) if ids is None else ids == wanted
        passed = (distance > 0.5 * voxel) & (~own | (depth - z > truncation))
        self._sums[EMPTY].index_add_(0, voxels, torch.where(passed, weight, 0.0))
        # Behind the surface trust fades: what is there may be the far side of something thin.
        faded = weight * ((truncation + distance) / (truncation - voxel)).clamp_max(1.0)
        faded = torch.where(distance.abs() <= truncation, faded, 0.0)
        if ids is not None:
            self._sums[OTHER].index_add_(0, voxels, torch.where(~own & (ids >= 0), faded, 0.0))
        rows = torch.nonzero(own & (distance.abs() <= truncation))[:, 0]
        faded, voxels, pixel = faded[rows], voxels[rows], pixel[rows]
        self._sums[DISTANCE].index_add_(0, voxels, faded * distance[rows])
        self._sums[WEIGHT].index_add_(0, voxels, faded)
        self._sums[VIEWS].index_add_(0, voxels, torch.ones_like(faded))
        if view.colours is not None:
            self._sums[RED : RED + 3].index_add_(1, voxels, faded * view.colours[pixel].T)


def _depth_at(
    view: DeviceDepth,
    u: Float[Tensor, "m"],
    v: Float[Tensor, "m"],
    pixel: Int64[Tensor, "m"],
    agree: float,
    ids: Int16[Tensor, "m"] | None,
) -> Float[Tensor, "m"]:
    """Depth along rays: bilinear where the four pixels round a place are one surface, else the nearest's."""
    x, y = (u - 0.5).floor().long(), (v - 0.5).floor().long()
    within = (x >= 0) & (y >= 0) & (x + 1 < view.camera.width) & (y + 1 < view.camera.height)
    first = torch.where(within, y * view.camera.width + x, 0)
    places = [first, first + 1, first + view.camera.width, first + view.camera.width + 1]
    places = [place.clamp_max(len(view.depth) - 1) for place in places]
    four = torch.stack([view.depth[place] for place in places])
    smooth = within & (four.amax(0) - four.amin(0) <= agree)  # false where one is NaN
    if ids is not None and view.ids is not None:
        for place in places:
            smooth = smooth & (view.ids[place] == ids)
    s, t = u - 0.5 - x, v - 0.5 - y
    between = (1 - t) * ((1 - s) * four[0] + s * four[1]) + t * ((1 - s) * four[2] + s * four[3])
    return torch.where(smooth, between, view.depth[pixel])
