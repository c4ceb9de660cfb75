"""Other ways to read a capture whose views do not agree: each is a mistake that people make, and what says it away."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from goc.capture.checks.depth_views import DepthViews
from goc.capture.convention import OPENCV_AXES, Convention, reread
from goc.capture.source import CameraAxes, PoseDirection, Source, StoredDepthKind

_DIRECTIONS: tuple[PoseDirection, ...] = ("camera-to-world", "world-to-camera")
_FOCALS = (0.25, 0.5, 0.6, 0.75, 0.86, 1.16, 1.33, 1.67, 2.0, 4.0)
_RADIAL = (-0.4, -0.35, -0.3, -0.25, -0.2, -0.15, -0.1, -0.05, 0.05, 0.1, 0.15, 0.2, 0.3)
OPTION = "--capture.convention"
PLATEAU = 0.02
"""Share of a view's pixels that have exactly the farthest depth, from which on that is no measurement."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What readings are tried on."""

    source: Source
    views: DepthViews
    indices: tuple[int, ...]
    """Of `views` among the views of the capture."""
    poses: Float64[np.ndarray, "n 4 4"]
    """Of all views of the capture, as read."""
    kind: StoredDepthKind = "metric"
    """How stored depth was read: as z (metric) or distance."""

    @property
    def depth_steps(self) -> float:
        """Steps of stored depth in a scene unit."""
        own = (view.depth_units_per_metre for view in self.source.views if view.depth is not None)
        return next((steps for steps in own if steps), self.source.depth_units_per_metre)

    def thinned(self, views: int, points: int) -> "Evidence":
        """The same with fewer views, and fewer points in each."""
        rows = np.unique(np.linspace(0, len(self.indices) - 1, views).round().astype(int))
        return replace(self, views=self.views.thinned(rows, points), indices=tuple(self.indices[row] for row in rows))


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """One way to understand the numbers of a capture."""

    looks: str
    """What it would mean: `poses look world-to-camera`."""
    remedy: str
    views: DepthViews


def other_conventions(source: Source) -> Iterator[Convention]:
    """Every direction and camera axes of poses that have a name, except those of the format."""
    for direction, axes in itertools.product(_DIRECTIONS, OPENCV_AXES):
        if (direction, axes) != (source.direction, source.axes):
            yield Convention(poses=direction, axes=axes)


def convention_words(source: Source, convention: Convention) -> tuple[str, str]:
    """What poses look like, and the options that say so."""
    words, options = [], []
    if convention.poses not in (None, source.direction):
        words.append(convention.poses)
        options.append(f"{OPTION}.poses {convention.poses}")
    if convention.axes not in (None, source.axes):
        named = _axes_words(convention.axes)
        words.append(f"with {named} axes" if words else f"to have {named} axes")
        options.append(f"{OPTION}.axes {convention.axes}")
    return " ".join(words), " ".join(options)


def pose_readings(evidence: Evidence) -> Iterator[Reading]:
    """The direction of poses and the camera axes, by their names and options."""
    source, poses = evidence.source, evidence.views.poses
    for convention in other_conventions(source):
        looks, options = convention_words(source, convention)
        views = _posed(evidence.views, reread(poses, source, convention))
        yield Reading(looks=f"poses look {looks}", remedy=f"Pass {options}.", views=views)


def mixed_readings(evidence: Evidence) -> Iterator[Reading]:
    """Rotation and position that do not belong together, and cameras on their side."""
    views, source = evidence.views, evidence.source
    rotation, position = views.poses[:, :3, :3], views.poses[:, :3, 3]
    own = OPENCV_AXES[source.axes]
    stored = rotation @ own.T  # in the file's camera axes, of which its numbers are
    back = -np.einsum("vji,vj->vi", stored, position)
    remedy = f"Write {source.direction} matrices."
    where = "the last column of the poses looks like the translation of the inverse (-R^T t), not their position"
    yield Reading(looks=where, remedy=remedy, views=_posed(views, _pose(rotation, back)))
    ahead = -np.einsum("vij,vj->vi", stored, position)
    yield Reading(looks=where, remedy=remedy, views=_posed(views, _pose(rotation, ahead)))
    words = "the rotations of the poses look transposed, their positions do not"
    yield Reading(looks=words, remedy=remedy, views=_posed(views, _pose(np.swapaxes(stored, 1, 2) @ own, position)))
    for quarter, words in ((1, "a quarter turn to the left"), (2, "half a turn"), (3, "a quarter turn to the right")):
        yield Reading(
            looks=f"images look turned by {words} against their poses (EXIF orientation)",
            remedy="Store the pixels as the poses see them, or turn the poses too.",
            views=_posed(views, _pose(rotation @ _roll(quarter), position)),
        )
    on_side = views.sizes[:, 0] < views.sizes[:, 1]
    if 0 < on_side.sum() < len(views):
        for quarter in (1, 2, 3):
            some = np.where(on_side[:, None, None], rotation @ _roll(quarter), rotation)
            yield Reading(
                looks=f"upright and wide images look turned against each other by {90 * quarter} degrees",
                remedy="Turn the pixels of the upright ones, or their poses, so that both fit.",
                views=_posed(views, _pose(some, position)),
            )
    for turned, words in _axis_turns(source.axes):
        looks = f"the cameras' axes look like {words} instead of {_axes_words(source.axes)} ones"
        yield Reading(
            looks=looks, remedy="Turn the rotations.", views=_posed(views, _pose(rotation @ turned, position))
        )
    for signs in itertools.product((1.0, -1.0), repeat=3):
        if signs != (1.0, 1.0, 1.0):
            axes = ", ".join(axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0)
            yield Reading(
                looks=f"the positions look mirrored ({axes} negated) against the rotations",
                remedy="Convert rotation and position together; a left-handed world needs both.",
                views=_posed(views, _pose(rotation, position * signs)),
            )


def depth_readings(evidence: Evidence) -> Iterator[Reading]:
    """What a value of depth may mean, its unit apart, and pictures that are not the right way round."""
    views = evidence.views
    if evidence.kind == "distance":
        looks = "depth looks like z along the camera's axis, not the distance from its centre"
        turned, remedy = views.depth * _lengths(views), "Pass --capture.depth-kind metric."
    else:
        looks = "depth looks like the distance from the camera's centre, not z along its axis"
        turned, remedy = views.depth / _lengths(views), "Pass --capture.depth-kind distance."
    yield Reading(looks=looks, remedy=remedy, views=replace(views, depth=turned.astype(np.float32)))
    farthest = float(np.nanmax(views.depth))
    if np.median((views.depth == farthest).mean((1, 2))) > PLATEAU:
        yield Reading(
            looks=f"depth of exactly {farthest * evidence.depth_steps:.6g} looks like the mark of pixels without depth",
            remedy="Write 0 there.",
            views=replace(views, depth=np.where(views.depth == farthest, np.nan, views.depth)),
        )
    for name, axes in (("left and right", 1), ("upside down", 0), ("by half a turn", (0, 1))):
        turned = views.depth.copy()
        for row, (width, height) in enumerate(views.sizes):
            turned[row, :height, :width] = np.flip(views.depth[row, :height, :width], axes)
        yield Reading(
            looks=f"depth images look flipped ({name}) against the poses",
            remedy="Store depth as the colour images are stored.",
            views=replace(views, depth=turned),
        )


def raster_readings(evidence: Evidence) -> Iterator[Reading]:
    """Intrinsics of another raster, a principal point that is not one, and a lens that was left out."""
    views = evidence.views
    middle = views.sizes / 2
    yield Reading(
        looks="the principal point looks wrong, the image's middle fits",
        remedy="Give cx and cy in pixels of the stored image, or leave them out.",
        views=replace(views, centre_px=middle),
    )
    for factor in _FOCALS:
        yield Reading(
            looks=f"intrinsics look like those of another raster: {factor:g} times the focal length fits",
            remedy="Give fx fy cx cy for the size of the stored images, or crop depth as the colour images are.",
            views=replace(views, focal_px=views.focal_px * factor, centre_px=middle),
        )
        yield Reading(
            looks=f"intrinsics look like those of another size: {factor:g} times fx fy cx cy fit",
            remedy="Give fx fy cx cy for the size of the stored images.",
            views=replace(views, focal_px=views.focal_px * factor, centre_px=views.centre_px * factor),
        )
    for radial in _RADIAL:
        yield Reading(
            looks=f"the lens's distortion looks left out (k1 near {radial:g} fits)",
            remedy="Give the calibration's k1 k2 p1 p2, or undistort images, depth and ids first.",
            views=replace(views, radial=radial),
        )


def pairing_readings(evidence: Evidence) -> Iterator[Reading]:
    """Poses and images that were paired in another order."""
    names = [view.name for view in evidence.source.views]
    count = len(evidence.poses)
    if len(names) != count:
        return
    order = np.arange(count)
    as_text, as_numbers = _order(names, key=str), _order(names, key=_natural)
    candidates = {
        "one view late": np.minimum(order + 1, count - 1),
        "one view early": np.maximum(order - 1, 0),
        "in reverse": order[::-1],
        "in the order of their names as text (1, 10, 2), not of their numbers": as_numbers[np.argsort(as_text)],
        "in the order of their numbers, not of their names as text (1, 10, 2)": as_text[np.argsort(as_numbers)],
    }
    for words, permuted in candidates.items():
        if (permuted != order).any():
            yield Reading(
                looks=f"poses look paired with the images {words}",
                remedy="Pair poses and images by name or number.",
                views=_posed(evidence.views, evidence.poses[permuted[list(evidence.indices)]]),
            )


def scaled(views: DepthViews, factor: float) -> DepthViews:
    """Views whose depth is `factor` times what it was, up to the world's unit: positions are divided instead."""
    poses = views.poses.copy()
    poses[:, :3, 3] /= factor
    return replace(views, poses=poses)


def inverted(views: DepthViews) -> DepthViews:
    """Views whose stored depth D is disparity, 1 / z, up to a factor."""
    middle = float(np.nanmedian(views.values))
    return replace(views, depth=(middle * middle / views.depth).astype(np.float32))


def _axes_words(axes: CameraAxes) -> str:
    return {"opencv": "OpenCV", "opengl": "OpenGL", "ros": "ROS"}[axes]


def _posed(views: DepthViews, poses: Float64[np.ndarray, "v 4 4"]) -> DepthViews:
    return replace(views, poses=poses)


def _pose(rotation: Float64[np.ndarray, "v 3 3"], position: Float64[np.ndarray, "v 3"]) -> Float64[np.ndarray, "v 4 4"]:
    made = np.tile(np.eye(4), (len(rotation), 1, 1))
    made[:, :3, :3], made[:, :3, 3] = rotation, position
    return made


def _roll(quarters: int) -> Float64[np.ndarray, "3 3"]:
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.linalg.matrix_power(turned, quarters)


def _axis_turns(axes: CameraAxes) -> Iterator[tuple[Float64[np.ndarray, "3 3"], str]]:
    """Turns of the axes as read, for all axes that have no name here; with the words for the file's x, y and z."""
    names = {(0, 1): "right", (0, -1): "left", (1, 1): "down", (1, -1): "up", (2, 1): "forward", (2, -1): "back"}
    rolls = [_roll(quarters) for quarters in range(4)]
    for order, signs in itertools.product(itertools.permutations(range(3)), itertools.product((1, -1), repeat=3)):
        named = np.zeros((3, 3))
        named[list(range(3)), list(order)] = signs
        turned = OPENCV_AXES[axes].T @ named
        known = any(np.allclose(named, one) for one in OPENCV_AXES.values())
        if np.linalg.det(named) > 0 and not known and not any(np.allclose(turned, one) for one in rolls):
            words = [names[order[row], signs[row]] for row in range(3)]
            yield turned, f"x {words[0]}, y {words[1]}, z {words[2]}"


def _lengths(views: DepthViews) -> Float64[np.ndarray, "v h w"]:
    """Length of the ray with z = 1 through each pixel."""
    height, width = views.depth.shape[1:]
    x = (np.arange(width) + 0.5 - views.centre_px[:, :1]) / views.focal_px[:, :1]
    y = (np.arange(height) + 0.5 - views.centre_px[:, 1:]) / views.focal_px[:, 1:]
    return np.sqrt(1 + x[:, None] ** 2 + y[..., None] ** 2)


def _order(names: list[str], key: Callable[[str], Any]) -> Int64[np.ndarray, "n"]:
    return np.array(sorted(range(len(names)), key=lambda row: key(names[row])))


def _natural(name: str) -> tuple[tuple[int, str], ...]:
    """Sorts digits as numbers."""
    parts = itertools.groupby(name, str.isdigit)
    return tuple((int(text), "") if digits else (0, text) for digits, text in ((d, "".join(g)) for d, g in parts))
