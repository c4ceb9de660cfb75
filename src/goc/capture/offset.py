"""Positions lose their offset before they become float32, which keeps seven digits."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from goc.capture.source import FarPoints, View, complain
from goc.events import Listener, Warned
from goc.scene import PointCloud

_FAR = 1000.0
"""Positions that are this far away, and this many times farther than the path is long, lose their offset: national
grids do, rooms whose origin is at their door do not. float32 then still keeps 0.1 mm."""

_WIDEST = 1e6
"""Captures that are longer keep no useful digits at all."""
Offset = tuple[float, float, float]


def offset_of(poses: Sequence[Float64[np.ndarray, "4 4"]]) -> Offset:
    """What to take off all positions, whole units; zeros where they are near the origin."""
    positions = np.stack([pose[:3, 3] for pose in poses])
    middle = np.median(positions, 0)
    extent = np.ptp(positions, 0).max()
    away = np.abs(middle).max()
    if away < _FAR or away < _FAR * 0.1 * extent:
        return 0.0, 0.0, 0.0
    x, y, z = np.rint(middle).tolist()
    return x, y, z


def without_offset(where: Path, views: tuple[View, ...], offset: Offset, notify: Listener) -> tuple[View, ...]:
    """The views nearer to the origin; says so where they were moved.

    Raises:
        CaptureError: views are so far from the others that float32 cannot tell them apart.
    """
    astray = [view for view in views if np.abs(view.world_from_cam[:3, 3] - offset).max() > _WIDEST]
    if astray:
        farthest = np.abs(astray[0].world_from_cam[:3, 3] - offset).max()
        names = [f"{view.name}, {farthest:.3g} units" for view in astray]
        raise complain(where, names, len(views), "views are too far from the others", "Remove or correct them.")
    if not any(offset):
        return views
    text = ", ".join(f"{value:g}" if abs(value) < 1e6 else f"{value:.0f}" for value in offset)
    message = f"The capture is far from its origin: {text} is taken off all positions (offset in scene.json)"
    notify(Warned(stage="capture", message=message))
    return tuple(replace(view, world_from_cam=_moved(view.world_from_cam, offset)) for view in views)


def points_without(points: PointCloud | FarPoints | None, offset: Offset) -> PointCloud | None:
    """Points in float32, nearer to the origin."""
    if points is None or isinstance(points, PointCloud) and not any(offset):
        return points
    positions = (points.positions.astype(np.float64) - offset).astype(np.float32)
    if isinstance(points, PointCloud):
        return replace(points, positions=positions)
    return PointCloud(positions=positions, colours=points.colours)


def _moved(pose: Float64[np.ndarray, "4 4"], offset: Offset) -> Float64[np.ndarray, "4 4"]:
    moved = pose.copy()
    moved[:3, 3] -= offset
    return moved
