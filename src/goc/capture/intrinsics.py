"""The intrinsics of a transforms.json, from the top of the file and from a frame."""

import math
from pathlib import Path

import msgspec

from goc.capture.source import Lens, shown
from goc.files import image_size

_PERSPECTIVE = ("OPENCV", "PINHOLE", "RADIAL", "SIMPLE_PINHOLE", "SIMPLE_RADIAL")
_LARGEST_SIDE = 1 << 16


class LensError(ValueError):
    """What is wrong with intrinsics and what to do, without the file's name."""


class Intrinsics(msgspec.Struct, kw_only=True):
    """May stand at the top, for all frames, or in a frame, which then wins. Pixels and radians."""

    camera_model: str | None = None
    is_fisheye: bool | None = None
    w: float | None = None
    h: float | None = None
    fl_x: float | None = None
    fl_y: float | None = None
    camera_angle_x: float | None = None
    camera_angle_y: float | None = None
    cx: float | None = None
    cy: float | None = None
    k1: float | None = None
    k2: float | None = None
    k3: float | None = None
    k4: float | None = None
    p1: float | None = None
    p2: float | None = None


def lens_of(shared: Intrinsics, own: Intrinsics, image: Path | None) -> Lens:
    """Intrinsics of one frame.

    Args:
        shared: from the top of the file.
        own: from the frame; what it gives wins.
        image: whose header gives the size where the file does not; None if it is missing.

    Raises:
        LensError: an unsupported camera model, or numbers that are missing or make no sense.
        FileError: the image's header is damaged.
    """
    given = _merged(shared, own)
    if given.is_fisheye or (given.camera_model is not None and given.camera_model not in _PERSPECTIVE):
        named = "with is_fisheye" if given.is_fisheye else shown(given.camera_model or "")
        remedy = f"Undistort the images first, or use one of {', '.join(_PERSPECTIVE)}."
        raise LensError(f"camera model {named} is not supported. {remedy}")
    width, height = _size(given, image)
    return Lens(
        width,
        height,
        _focal(given, width, height),
        _centre(given, width, height),
        radial=(given.k1 or 0.0, given.k2 or 0.0, given.k3 or 0.0, given.k4 or 0.0),
        tangential=(given.p1 or 0.0, given.p2 or 0.0),
    )


def _merged(shared: Intrinsics, own: Intrinsics) -> Intrinsics:
    values = {}
    for name in Intrinsics.__struct_fields__:
        value = getattr(own, name)
        values[name] = getattr(shared, name) if value is None else value
    return Intrinsics(**values)


def _size(given: Intrinsics, image: Path | None) -> tuple[int, int]:
    if given.w is None or given.h is None:
        # a missing image is reported by count later; until then any size will do
        return (2, 2) if image is None else image_size(image)
    for side in (given.w, given.h):
        if side != int(side) or not 1 <= side <= _LARGEST_SIDE:
            raise LensError(f"w and h are {given.w:g} and {given.h:g}. Give the image's size in pixels.")
    return int(given.w), int(given.h)


def _focal(given: Intrinsics, width: int, height: int) -> tuple[float, float]:
    across = given.fl_x if given.fl_x is not None else _from_angle(given.camera_angle_x, width)
    down = given.fl_y if given.fl_y is not None else _from_angle(given.camera_angle_y, height)
    across, down = down if across is None else across, across if down is None else down
    if across is None or down is None:
        raise LensError("no focal length. Give fl_x (pixels) or camera_angle_x (radians).")
    if not (0 < across < math.inf and 0 < down < math.inf):
        raise LensError(f"focal lengths are {across:g} and {down:g}. They must be positive pixels.")
    return across, down


def _from_angle(angle: float | None, side: int) -> float | None:
    """Focal length in pixels of a full angle of view; 0, which is refused, for an angle that cannot be."""
    if angle is None:
        return None
    return 0.5 * side / math.tan(0.5 * angle) if 0 < angle < math.pi else 0.0


def _centre(given: Intrinsics, width: int, height: int) -> tuple[float, float]:
    x = width / 2 if given.cx is None else given.cx
    y = height / 2 if given.cy is None else given.cy
    if 0 <= x <= width and 0 <= y <= height:
        return x, y
    raise LensError(
        f"the principal point {x:g}, {y:g} is outside the image of {width} x {height}. Give cx, cy in pixels."
    )
