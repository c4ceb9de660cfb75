"""The intrinsics of a transforms.json, from the top of the file and from a frame."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from goc.capture.source import Lens, equirectangular, shown
from goc.files import image_size

_PERSPECTIVE = ("OPENCV", "PINHOLE", "RADIAL", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "FULL_OPENCV")
_FISHEYE = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "FISHEYE", "THIN_PRISM_FISHEYE")
_PANORAMA = "EQUIRECTANGULAR"
_LISTED = ("k1", "k2", "k3", "k4", "p1", "p2")
"""Order of nerfstudio's distortion_params; OpenCV's own is k1 k2 p1 p2 k3."""
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
    k5: float | None = None
    k6: float | None = None
    p1: float | None = None
    p2: float | None = None
    sx1: float | None = None
    sy1: float | None = None
    distortion_params: list[float] | None = None
    fisheye_crop_radius: float | None = None


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
    model = "OPENCV_FISHEYE" if given.is_fisheye else given.camera_model or "OPENCV"
    if model not in (*_PERSPECTIVE, *_FISHEYE, _PANORAMA):
        known = ", ".join((*_PERSPECTIVE, *_FISHEYE, _PANORAMA))
        raise LensError(f"camera model {shown(model)} is not supported. Undistort the images first, or use {known}.")
    width, height = _size(given, image)
    if model == _PANORAMA:
        return equirectangular(width, height)
    focal, centre = _focal(given, width, height), _centre(given, width, height)
    return replace(Lens(width, height, focal, centre), **_distortion(model, given))


def _distortion(model: str, given: Intrinsics) -> dict[str, Any]:
    """Fields of `Lens` that its focal lengths and centre leave open."""
    k1, k2, k3, k4, k5, k6 = (getattr(given, name) or 0.0 for name in ("k1", "k2", "k3", "k4", "k5", "k6"))
    tangential = (given.p1 or 0.0, given.p2 or 0.0)
    if not all(math.isfinite(number) for number in (k1, k2, k3, k4, k5, k6, *tangential)):
        raise LensError("distortion coefficients are not finite. Correct them.")
    if model == "FULL_OPENCV":
        return {"radial": (k1, k2, k3), "denominator": (k4, k5, k6), "tangential": tangential}
    if k5 or k6:
        raise LensError(f"k5 and k6 have no meaning in camera model {model}. Use FULL_OPENCV, or leave them out.")
    if model not in _FISHEYE:
        return {"radial": (k1, k2, k3, k4), "tangential": tangential}
    circle = given.fisheye_crop_radius if given.fisheye_crop_radius and given.fisheye_crop_radius > 0 else None
    bent: dict[str, Any] = {"projection": "fisheye", "radial": (k1, k2, k3, k4), "circle_px": circle}
    if model == "THIN_PRISM_FISHEYE":
        bent |= {"tangential": tangential, "prism": (given.sx1 or 0.0, 0.0, given.sy1 or 0.0, 0.0)}
    return bent


def _merged(shared: Intrinsics, own: Intrinsics) -> Intrinsics:
    values = {}
    for name in Intrinsics.__struct_fields__:
        value = getattr(own, name)
        values[name] = getattr(shared, name) if value is None else value
    listed = values["distortion_params"]
    if listed:
        if len(listed) > len(_LISTED):
            order = " ".join(_LISTED)
            raise LensError(f"distortion_params has {len(listed)} numbers. Give at most six: {order}.")
        for name, number in zip(_LISTED, listed, strict=False):
            if values[name] is not None and values[name] != number:
                raise LensError(f"{name} is {values[name]:g}, but {number:g} in distortion_params. Keep one of them.")
            values[name] = number
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
