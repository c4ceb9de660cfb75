"""A sample of views with depth, small enough that hundreds of ways to read them can be tried in a second or two."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64, Int64

from goc.scene import Frame

_GRID_POINTS = 320
"""Points of a view that are carried into the others, about."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthViews:
    """Depth of v views, read in one way. The fields state that way: other readings are copies with one replaced."""

    poses: Float64[np.ndarray, "v 4 4"]
    """World from camera, OpenCV axes, rigid."""
    focal_px: Float64[np.ndarray, "v 2"]
    centre_px: Float64[np.ndarray, "v 2"]
    depth: Float32[np.ndarray, "v h w"]
    """z, scene units, NaN = none; smaller views lie in the upper left corner."""
    sizes: Int64[np.ndarray, "v 2"]
    """Width and height of each view."""
    pixels: Float64[np.ndarray, "v p 2"]
    """Centres of the pixels that are carried into other views."""
    radial: float = 0.0
    """k1 of the lens that the pixels were seen through: a distorted radius is r (1 + k1 r²)."""

    @property
    def typical(self) -> float:
        """Median depth."""
        values = self.values
        return float(np.median(values[np.isfinite(values)], overwrite_input=True))

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def values(self) -> Float64[np.ndarray, "v p"]:
        """Depth at `pixels`; NaN = none."""
        at = np.floor(self.pixels).astype(int)
        return self.depth[np.arange(len(at))[:, None], at[..., 1], at[..., 0]].astype(np.float64)

    @property
    def directions(self) -> Float64[np.ndarray, "v p 2"]:
        """X / z and y / z through `pixels`, freed of the lens's distortion; NaN beyond where it folds back."""
        seen = (self.pixels - self.centre_px[:, None]) / self.focal_px[:, None]
        if not self.radial:
            return seen
        straight = seen
        for _ in range(20):
            straight = seen / np.maximum(1 + self.radial * (straight**2).sum(-1, keepdims=True), 0.5)
        within = (straight**2).sum(-1, keepdims=True) < self.fold
        return np.where(within, straight, np.nan)

    @property
    def fold(self) -> float:
        """Squared radius, undistorted, where the lens's distorted radius stops growing, less a margin."""
        return -0.9 / (3 * self.radial) if self.radial < 0 else float("inf")

    def thinned(self, rows: Int64[np.ndarray, "r"], points: int) -> "DepthViews":
        """Some of the views, with about that many points each."""
        side = round(self.pixels.shape[1] ** 0.5)
        kept = np.unique(np.linspace(0, side - 1, round(points**0.5)).round().astype(int))
        grid = self.pixels.reshape(len(self.pixels), side, side, 2)[rows][:, kept][:, :, kept]
        return replace(
            self,
            poses=self.poses[rows],
            focal_px=self.focal_px[rows],
            centre_px=self.centre_px[rows],
            depth=self.depth[rows],
            sizes=self.sizes[rows],
            pixels=grid.reshape(len(rows), -1, 2),
        )

    def points(self) -> Float64[np.ndarray, "v p 3"]:
        """World points of `pixels`; NaN = none."""
        rays = np.concatenate([self.directions, np.ones((*self.pixels.shape[:2], 1))], -1)
        local = rays * self.values[..., None]
        return np.einsum("vij,vpj->vpi", self.poses[:, :3, :3], local) + self.poses[:, None, :3, 3]


def depth_views(frames: Sequence[Frame]) -> DepthViews:
    """Take the depth of those frames that have any, as their cameras read it."""
    kept = [frame for frame in frames if frame.depth is not None and bool(frame.depth.isfinite().any())]
    cameras = [frame.camera.double() for frame in kept]
    return DepthViews(
        poses=np.stack([camera.world_from_cam.numpy() for camera in cameras]),
        focal_px=np.stack([camera.focal_px.numpy() for camera in cameras]),
        centre_px=np.stack([camera.centre_px.numpy() for camera in cameras]),
        depth=_stacked([frame.depth.numpy() for frame in kept if frame.depth is not None]),
        sizes=np.array([[camera.width, camera.height] for camera in cameras]),
        pixels=np.stack([_grid(camera.width, camera.height) for camera in cameras]),
    )


def _stacked(images: Sequence[Float32[np.ndarray, "_ _"]]) -> Float32[np.ndarray, "v h w"]:
    height, width = np.max([image.shape for image in images], axis=0)
    stack = np.full((len(images), height, width), np.nan, np.float32)
    for row, image in zip(stack, images, strict=True):
        row[: image.shape[0], : image.shape[1]] = image
    return stack


def _grid(width: int, height: int) -> Float64[np.ndarray, "p 2"]:
    """Pixel centres spread evenly over an image; as many for every size."""
    side = round(_GRID_POINTS**0.5)
    across = (np.floor((np.arange(side) + 0.5) / side * width) + 0.5).clip(0.5, width - 0.5)
    down = (np.floor((np.arange(side) + 0.5) / side * height) + 0.5).clip(0.5, height - 0.5)
    return np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)
