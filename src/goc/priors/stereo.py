"""Depth from photographs alone: plane sweep, semi-global smoothing, slanted planes, and what other views confirm."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int32, UInt8

from goc import _native
from goc.events import Listener, Progress, ignore
from goc.geometry.native_camera import native_camera
from goc.geometry.normals import fitted_normals
from goc.geometry.parallax import parallax_views
from goc.priors.config import StereoConfig
from goc.scene.camera import Camera
from goc.scene.capture import Capture
from goc.scene.priors import CoarseDepth

_TYPICAL_DISTANCE_M = 2.0
_CHUNK = 16
"""Views between two progress events."""
_CONFIRMING = 12
"""Views asked whether they agree; the best of them are matched with."""
_REFINING = 5
"""Views that slanted planes are matched with: the dearest part."""
_STEP_PENALTY, _JUMP_PENALTY = 0.2, 1.6
"""For neighbouring pixels one plane, and more planes, apart, in units of 1 - ZNCC."""
_PRIOR_WEIGHT = 0.04
"""For leaving what the sweep found, in the same units."""
_REPROJECTION_PX, _RELATIVE = 1.0, 0.02
"""Views agree where their surfaces are no farther apart than this, in pixels and as a share of depth."""
_WORST_COST = 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scale:
    """The photographs at one size, stacked on one raster."""

    cameras: list[Camera]
    photos: _native.Photos
    shape: tuple[int, int, int]

    def zeros(self, *channels: int) -> Float32[np.ndarray, "v ..."]:
        return np.zeros((*self.shape, *channels), np.float32)


def stereo_depths(
    capture: Capture, views: list[int], config: StereoConfig, notify: Listener = ignore
) -> dict[int, CoarseDepth]:
    """Match each view with its neighbours, and keep what at least `config.agreeing` other views confirm.

    The same bits for any number of threads.

    Args:
        capture: photographs and poses; nothing else of it is looked at.
        views: indices of the views to match, with each other alone.
        config: sizes and counts.
        notify: hears Progress.

    Returns:
        Depth of each view asked for, by its index, or of `config.max_views` of them spread evenly; NaN where too few
        other views confirm it.
    """
    if len(views) > config.max_views:
        views = [views[i * len(views) // config.max_views] for i in range(config.max_views)]
    small, half, full = (_scale(capture, views, config.side_px // divisor) for divisor in (4, 2, 1))
    confirming = max(_CONFIRMING, config.neighbours)
    wide = parallax_views(full.cameras, _TYPICAL_DISTANCE_M * capture.units_per_metre, confirming)
    around = np.ascontiguousarray(wide[:, : config.neighbours])
    far, near = 1.0 / (config.far_m * capture.units_per_metre), 1.0 / (config.near_m * capture.units_per_metre)
    far, near = _narrowed(small, around, config, far, near)
    inverse = _sweep(half, around, config.planes, far, near, notify)
    planes = _finer(half, full, inverse)
    costs = _refine(full, around, planes, (near - far) / (config.planes - 1), config, notify)
    agreed, agreeing, against = _agree(full, wide, planes)
    trusted = (agreeing >= config.agreeing) & (agreeing > against) & (costs <= _WORST_COST)
    return {
        view: _view(camera, agreed[place], trusted[place])
        for place, (view, camera) in enumerate(zip(views, full.cameras, strict=True))
    }


def _scale(capture: Capture, views: list[int], side: int) -> _Scale:
    cameras, greys = [], []
    for view in views:
        camera = capture.cameras[view]
        ratio = side / max(camera.width, camera.height)
        cameras.append(camera.resized(max(1, round(camera.width * ratio)), max(1, round(camera.height * ratio))))
        image = capture[view].image.float().mean(-1)[None, None]
        size = (cameras[-1].height, cameras[-1].width)
        mode = "area" if ratio < 1 else "bilinear"
        greys.append(torch.nn.functional.interpolate(image, size, mode=mode)[0, 0].numpy())
    shape = (len(views), max(grey.shape[0] for grey in greys), max(grey.shape[1] for grey in greys))
    stack = np.zeros(shape, np.float32)
    for place, grey in enumerate(greys):
        stack[place, : grey.shape[0], : grey.shape[1]] = grey
    return _Scale(
        cameras=cameras, photos=_native.Photos(stack, [native_camera(camera) for camera in cameras]), shape=shape
    )


def _chunks(count: int) -> list[tuple[int, int]]:
    return [(first, min(first + _CHUNK, count)) for first in range(0, count, _CHUNK)]


def _sweep(
    scale: _Scale, around: Int32[np.ndarray, "v k"], planes: int, far: float, near: float, notify: Listener
) -> Float32[np.ndarray, "v h w"]:
    inverse, costs = scale.zeros(), scale.zeros()
    ranges = np.tile(np.array([[far, near]], np.float32), (scale.shape[0], 1))
    for first, last in _chunks(scale.shape[0]):
        _native.stereo_sweep(
            scale.photos, first, last, around, ranges, planes, _STEP_PENALTY, _JUMP_PENALTY, inverse, costs
        )
        notify(Progress(stage="stereo", done=last, total=2 * scale.shape[0]))
    return inverse


def _narrowed(
    scale: _Scale, around: Int32[np.ndarray, "v k"], config: StereoConfig, far: float, near: float
) -> tuple[float, float]:
    """The range of inverse depth in which a small sweep finds surface that views agree on."""
    inverse = _sweep(scale, around, 64, far, near, ignore)
    agreed, agreeing, against = _agree(scale, around, _with_slopes(scale, inverse), relative=0.05)
    found = agreed[(agreeing >= config.agreeing) & (agreeing > against)]
    if len(found) < 100:
        return far, near
    low, high = np.percentile(found, [0.5, 99.5])
    return max(far, float(low) / 1.4), min(near, float(high) * 1.4)


def _with_slopes(scale: _Scale, inverse: Float32[np.ndarray, "v h w"]) -> Float32[np.ndarray, "v h w 3"]:
    """Planes through each pixel: its inverse depth, and slopes a pixel from planes fitted to its surroundings."""
    planes = scale.zeros(3)
    for place, camera in enumerate(scale.cameras):
        part = np.s_[place, : camera.height, : camera.width]
        value = torch.from_numpy(inverse[part])
        normals = fitted_normals(1.0 / value, camera, 2)
        facing = (normals * camera.rays()).sum(-1)
        slopes = normals[..., :2] * (value / facing)[..., None] / camera.focal_px
        planes[part][..., 0] = inverse[part]
        planes[part][..., 1:] = torch.nan_to_num(slopes, 0.0, 0.0, 0.0).numpy()
    return planes


def _finer(half: _Scale, full: _Scale, inverse: Float32[np.ndarray, "v h w"]) -> Float32[np.ndarray, "v H W 3"]:
    """The planes of the coarse pixels, at the pixels of the fine raster."""
    coarse, fine = _with_slopes(half, inverse), full.zeros(3)
    for place, (small, large) in enumerate(zip(half.cameras, full.cameras, strict=True)):
        along, down = small.width / large.width, small.height / large.height
        x, y = (np.arange(large.width) + 0.5) * along - 0.5, (np.arange(large.height) + 0.5) * down - 0.5
        near_x = np.clip(np.rint(x), 0, small.width - 1).astype(int)
        near_y = np.clip(np.rint(y), 0, small.height - 1).astype(int)
        planes = coarse[place][near_y[:, None], near_x]
        part = fine[place, : large.height, : large.width]
        part[..., 0] = planes[..., 0] + planes[..., 1] * (x - near_x) + planes[..., 2] * (y - near_y)[:, None]
        part[..., 0] = np.where(part[..., 0] > 0, part[..., 0], planes[..., 0])
        part[..., 1:] = planes[..., 1:] * [along, down]
    return fine


def _refine(
    scale: _Scale,
    around: Int32[np.ndarray, "v k"],
    planes: Float32[np.ndarray, "v h w 3"],
    step: float,
    config: StereoConfig,
    notify: Listener,
) -> Float32[np.ndarray, "v h w"]:
    """Improve the planes in place; returns how badly they match."""
    few = np.ascontiguousarray(around[:, :_REFINING])
    costs = scale.zeros()
    steps = np.full(scale.shape[0], step, np.float32)
    for first, last in _chunks(scale.shape[0]):
        _native.stereo_refine(
            scale.photos,
            first,
            last,
            few,
            steps,
            config.refinements,
            _PRIOR_WEIGHT,
            0,
            planes,
            costs,
        )
        notify(Progress(stage="stereo", done=scale.shape[0] + last, total=2 * scale.shape[0]))
    return costs


def _agree(
    scale: _Scale,
    around: Int32[np.ndarray, "v k"],
    planes: Float32[np.ndarray, "v h w 3"],
    relative: float = _RELATIVE,
) -> tuple[Float32[np.ndarray, "v h w"], UInt8[np.ndarray, "v h w"], UInt8[np.ndarray, "v h w"]]:
    agreed, agreeing, against = scale.zeros(), np.zeros(scale.shape, np.uint8), np.zeros(scale.shape, np.uint8)
    _native.stereo_agree(
        scale.photos, 0, scale.shape[0], around, planes, _REPROJECTION_PX, relative, agreed, agreeing, against
    )
    return agreed, agreeing, against


def _view(camera: Camera, inverse: Float32[np.ndarray, "h w"], trusted: Bool[np.ndarray, "h w"]) -> CoarseDepth:
    """One view out of the stack."""
    part = np.s_[: camera.height, : camera.width]
    depth = torch.where(torch.from_numpy(trusted[part]), torch.from_numpy(1.0 / inverse[part]), torch.nan)
    return CoarseDepth(camera=camera, depth=depth)
