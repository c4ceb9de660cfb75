"""Depth of many views → one sparse set of surface points with normals."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.ndimage import maximum_filter, minimum_filter

from goc.errors import SegmentError
from goc.events import Listener, Progress
from goc.geometry.voxels import HALF, cells_of, find_keys, pack_cells, sum_by_key
from goc.priors.segmentation.config import SegmentConfig
from goc.scene import Camera, Capture, Frame

MARGIN = 16
"""Cells kept free at the border of what keys can hold, for steps to neighbours."""
VOXEL_PER_DEPTH = 0.006
"""Voxel edge as a share of the median depth: about two pixels of a 384-pixel image of 66°."""
VOXEL_M = (0.004, 0.025)
"""Bounds of that edge, metres; coarse images may exceed it."""
PIXELS_PER_VOXEL = 1.3
"""A voxel spans at least so many pixels, or surfaces would come apart."""
PINHOLES = 0.02
"""Share of lone missing pixels from which a depth image counts as riddled with holes."""
MIN_LAYER_SHARE = 0.2
"""A voxel seen by fewer views than this share of those that saw the layer before or behind it is noise."""
MIN_VIEW_SHARE = 0.1
"""Where the typical voxel has many views, one with less than this share of them (at most three) is noise."""
EDGE = 0.04
"""Depth steps between neighbouring samples above this share of the depth are edges, where depth is not trusted."""


@dataclass(frozen=True, eq=False)
class SurfaceVoxels:
    """The fused surface of all views: one oriented point a voxel, ordered by key."""

    keys: Int64[np.ndarray, "v"]
    points: Float[np.ndarray, "v 3"]
    """Mean of the samples in the voxel, world."""
    normals: Float[np.ndarray, "v 3"]
    """Unit, towards the cameras."""
    views: Float[np.ndarray, "v"]
    """How many views saw it."""
    voxel: float

    def __len__(self) -> int:
        return len(self.keys)


def thinned(surface: SurfaceVoxels, rounds: int = 3) -> SurfaceVoxels:
    """Merge parallel layers of voxels, which noisy or drifting depth leaves, into one layer.

    Each point moves along its normal to the mean of the points before and behind it that face the same way, weighted by
    the views that saw them (mean shift, Fukunaga and Hostetler 1975); then points regroup in voxels. What is left
    before or behind a layer that far more views saw is dropped.
    """
    for _ in range(rounds):
        shift, weight, normals = np.zeros(len(surface)), surface.views.copy(), surface.normals * surface.views[:, None]
        for rows, others in _columns(surface, 3):
            along = ((surface.points[others] - surface.points[rows]) * surface.normals[rows]).sum(1)
            shift[rows] += surface.views[others] * along
            weight[rows] += surface.views[others]
            normals[rows] += surface.normals[others] * surface.views[others, None]
        moved = surface.points + surface.normals * (shift / weight)[:, None]
        surface = revoxelized(moved, normals, surface.views, surface.voxel)
    peak = surface.views.copy()
    for rows, others in _columns(surface, 6):
        peak[rows] = np.maximum(peak[rows], surface.views[others])
    kept = surface.views >= np.maximum(MIN_LAYER_SHARE * peak, min(3.0, MIN_VIEW_SHARE * np.median(surface.views)))
    return SurfaceVoxels(
        surface.keys[kept], surface.points[kept], surface.normals[kept], surface.views[kept], surface.voxel
    )


def _columns(surface: SurfaceVoxels, reach: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows, and those of the voxels that lie 1 … `reach` voxels before or behind them and face the same way."""
    for step in [step for step in range(-reach, reach + 1) if step]:
        ahead = surface.points + step * surface.voxel * surface.normals
        others = find_keys(surface.keys, pack_cells(cells_of(ahead, surface.voxel)))
        rows = np.flatnonzero(others >= 0)
        rows = rows[(surface.normals[rows] * surface.normals[others[rows]]).sum(1) > 0.3]
        yield rows, others[rows]


def revoxelized(points: np.ndarray, normals: np.ndarray, views: np.ndarray, voxel: float) -> SurfaceVoxels:
    """Points and directions, weighted by views, as a surface of the given voxel."""
    length = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    weight = views[:, None]
    rows = np.concatenate([points * weight, normals / length * weight, weight, weight], 1)
    return _surface(*sum_by_key(pack_cells(cells_of(points, voxel)), rows), voxel)


def back_project(depth: Float[np.ndarray, "h w"], camera: Camera, stride: int = 1) -> Float[np.ndarray, "r s 3"]:
    """World points of every `stride`-th pixel from its z; NaN where there is no depth."""
    z = torch.from_numpy(depth)[::stride, ::stride]
    exact = camera.double()
    return exact.in_world(exact.rays()[::stride, ::stride] * z[..., None]).numpy()


def depth_of(frame: Frame) -> Float[np.ndarray, "h w"] | None:
    """Depth of a view as float64, NaN where there is none or it is not positive; None if the view has none at all."""
    if frame.depth is None:
        return None
    z = frame.depth.detach().cpu().double().numpy()
    return np.where(np.isfinite(z) & (z > 0), z, np.nan)


def by_name(views: Capture) -> list[int]:
    """Views in the order of their names."""
    return sorted(range(len(views)), key=lambda index: views.view_names[index])


def fuse_depth(views: Capture, config: SegmentConfig, notify: Listener) -> SurfaceVoxels:
    """Fuse the depth of (at most `max_views`) views into voxels.

    Views are taken in the order of their names, so the result does not depend on the order of the capture.

    Raises:
        SegmentError: no view has depth, or no surface shows in it.
    """
    order = by_name(views)
    kept = [order[round(i)] for i in np.linspace(0, len(order) - 1, min(len(order), config.max_views))] if order else []
    voxel, stride = _resolution(views, kept, config)
    keys, sums = np.zeros(0, np.int64), np.zeros((0, 8))
    pending: list[tuple[np.ndarray, np.ndarray]] = []
    for done, index in enumerate(kept, 1):
        pending.append(_splat_view(views, index, voxel, stride))
        if len(pending) == 8 or done == len(kept):
            keys, sums = _merge([(keys, sums), *pending])
            pending = []
        while len(keys) > config.max_voxels:
            voxel *= 1.25
            keys, sums = _coarsen(sums, voxel)
        notify(Progress(stage="segment", done=done, total=len(kept), figures={"voxels": float(len(keys))}))
    if not len(keys):
        raise SegmentError(
            f"the depth of the {len(views)} views (first: {views.view_names[0]}) shows no continuous surface. "
            "Check its unit and that it is z along the optical axis, or give ids with the capture."
        )
    return _surface(keys, sums, voxel)


def _resolution(views: Capture, kept: list[int], config: SegmentConfig) -> tuple[float, int]:
    """Voxel edge in scene units and pixel stride, from the median depth of some views."""
    medians, footprints = [], []
    for index in kept[:: max(1, len(kept) // 12)] if views.has_metric_depth else []:
        z = depth_of(views[index])
        if z is not None and np.isfinite(z).any():
            medians.append(float(np.nanmedian(z)))
            footprints.append(medians[-1] / float(views.cameras[index].focal_px.max()))
    if not medians:
        first = views.view_names[0] if len(views) else "no view"
        raise SegmentError(
            f"none of the {len(views)} views has metric depth (first: {first}), "
            "and telling objects apart without masks needs it. Give depth images, or ids with the capture."
        )
    if config.voxel_m is not None:
        voxel = config.voxel_m * views.units_per_metre
    else:
        voxel = float(
            np.clip(VOXEL_PER_DEPTH * np.median(medians), *(side * views.units_per_metre for side in VOXEL_M))
        )
        voxel = max(voxel, PIXELS_PER_VOXEL * float(np.median(footprints)))
    return voxel, max(1, int(voxel / np.median(footprints) / PIXELS_PER_VOXEL))


def _splat_view(views: Capture, index: int, voxel: float, stride: int) -> tuple[np.ndarray, np.ndarray]:
    """Keys and sums (point 3, normal 3, samples, views) of the voxels that one view sees."""
    z = depth_of(views[index])
    if z is None:
        return np.zeros(0, np.int64), np.zeros((0, 8))
    z = without_pinholes(z)
    points = back_project(z, views.cameras[index], stride)
    normals = _normals(points, z[::stride, ::stride], views.cameras[index].position.double().numpy())
    reach = (HALF - MARGIN) * voxel
    with np.errstate(invalid="ignore"):
        chosen = np.isfinite(normals[..., 0]) & (np.abs(points) < reach).all(-1)
    points, normals = points[chosen], normals[chosen]
    rows = np.concatenate([points, normals, np.ones((len(points), 1)), np.zeros((len(points), 1))], 1)
    keys, sums = sum_by_key(pack_cells(cells_of(points, voxel)), rows)
    sums[:, 7] = 1
    return keys, sums


def without_pinholes(depth: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Fill lone missing pixels, such as a warp into another camera leaves, where what is round them is one surface."""
    missing = np.isnan(depth)
    lone = missing[:, 1:-1] & ~missing[:, :-2] & ~missing[:, 2:]
    if lone.mean() < PINHOLES:
        return depth
    high = maximum_filter(np.where(missing, -np.inf, depth), 3)
    low = minimum_filter(np.where(missing, np.inf, depth), 3)
    with np.errstate(invalid="ignore"):
        smooth = missing & (high - low <= EDGE * low)
        return np.where(smooth, 0.5 * (high + low), depth)


def _normals(
    points: Float[np.ndarray, "r s 3"], depth: Float[np.ndarray, "r s"], eye: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "r s 3"]:
    """Unit normals towards the eye from central differences; NaN at edges of depth and where a neighbour lacks it."""
    normals = np.full(points.shape, np.nan)
    right = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    centre = depth[1:-1, 1:-1]
    across = [depth[1:-1, 2:], depth[1:-1, :-2], depth[2:, 1:-1], depth[:-2, 1:-1]]
    flat = np.all([np.abs(side - centre) <= EDGE * centre for side in across], 0)
    cross = np.cross(down, right)
    length = np.linalg.norm(cross, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        cross /= length[..., None]
        cross *= np.sign(((eye - points[1:-1, 1:-1]) * cross).sum(-1))[..., None]
    cross[~flat] = np.nan
    normals[1:-1, 1:-1] = cross
    return normals


def _merge(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """One set of sums out of several."""
    return sum_by_key(np.concatenate([keys for keys, _ in parts]), np.concatenate([sums for _, sums in parts]))


def _coarsen(sums: np.ndarray, voxel: float) -> tuple[np.ndarray, np.ndarray]:
    """The same sums in larger voxels."""
    return sum_by_key(pack_cells(cells_of(sums[:, :3] / sums[:, 6:7], voxel)), sums)


def _surface(keys: np.ndarray, sums: np.ndarray, voxel: float) -> SurfaceVoxels:
    """Means out of sums."""
    normals = sums[:, 3:6] / np.maximum(np.linalg.norm(sums[:, 3:6], axis=1, keepdims=True), 1e-12)
    return SurfaceVoxels(keys, sums[:, :3] / sums[:, 6:7], normals, sums[:, 7], voxel)
