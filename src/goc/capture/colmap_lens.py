"""COLMAP's camera models as lenses, checked against pycolmap 4.2's img_from_cam to 1e-12 px."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from goc.capture.lens import Lens, equirectangular

_LARGEST_SIDE = 1 << 16


@dataclass(frozen=True)
class CameraModel:
    """One row of COLMAP's sensor/models.h."""

    name: str
    focals: int
    """1: one focal length for both axes."""
    count: int
    """Parameters, focal lengths and principal point included."""
    fields: Callable[[Sequence[float]], dict[str, Any]]
    """What is left of the parameters → fields of `Lens`."""


def _radial(k: Sequence[float]) -> dict[str, Any]:
    return {"radial": tuple(k)}


def _fisheye(k: Sequence[float]) -> dict[str, Any]:
    return {"projection": "fisheye", "radial": tuple(k)}


def _opencv(k: Sequence[float]) -> dict[str, Any]:
    return {"radial": (*k[:2], *k[4:5]), "tangential": tuple(k[2:4]), "denominator": tuple(k[5:8])}


def _thin_prism(k: Sequence[float]) -> dict[str, Any]:
    bent = {"radial": (*k[:2], *k[4:6]), "tangential": tuple(k[2:4]), "prism": (k[6], 0.0, k[7], 0.0)}
    return {"projection": "fisheye", **bent}


def _aria(k: Sequence[float]) -> dict[str, Any]:
    bent = {"radial": tuple(k[:6]), "tangential": (k[7], k[6]), "prism": tuple(k[8:12])}
    return {"projection": "fisheye", "bent_twice": True, **bent}


def _shaped(projection: str) -> Callable[[Sequence[float]], dict[str, Any]]:
    return lambda k: {"projection": projection, "shape": tuple(k)}


MODELS: dict[int, CameraModel] = {
    0: CameraModel("SIMPLE_PINHOLE", 1, 3, _radial),
    1: CameraModel("PINHOLE", 2, 4, _radial),
    2: CameraModel("SIMPLE_RADIAL", 1, 4, _radial),
    3: CameraModel("RADIAL", 1, 5, _radial),
    4: CameraModel("OPENCV", 2, 8, _opencv),
    5: CameraModel("OPENCV_FISHEYE", 2, 8, _fisheye),
    6: CameraModel("FULL_OPENCV", 2, 12, _opencv),
    7: CameraModel("FOV", 2, 5, _shaped("fov")),
    8: CameraModel("SIMPLE_RADIAL_FISHEYE", 1, 4, _fisheye),
    9: CameraModel("RADIAL_FISHEYE", 1, 5, _fisheye),
    10: CameraModel("THIN_PRISM_FISHEYE", 2, 12, _thin_prism),
    11: CameraModel("RAD_TAN_THIN_PRISM_FISHEYE", 2, 16, _aria),
    12: CameraModel("SIMPLE_DIVISION", 1, 4, _shaped("division")),
    13: CameraModel("DIVISION", 2, 5, _shaped("division")),
    14: CameraModel("SIMPLE_FISHEYE", 1, 3, _fisheye),
    15: CameraModel("FISHEYE", 2, 4, _fisheye),
    16: CameraModel("EUCM", 2, 6, _shaped("eucm")),
    17: CameraModel("EQUIRECTANGULAR", 0, 2, lambda k: {}),
}
BY_NAME = {model.name: model for model in MODELS.values()}


class ModelError(ValueError):
    """What is wrong with a camera, without the file's name."""


def lens_of_model(model: CameraModel, width: int, height: int, numbers: Sequence[float]) -> Lens:
    """The lens of one COLMAP camera.

    Raises:
        ModelError: another count of parameters, or numbers that make no sense.
    """
    if len(numbers) != model.count:
        raise ModelError(f"{model.name} has {model.count} parameters, found {len(numbers)}")
    if not all(1 <= side <= _LARGEST_SIDE for side in (width, height)):
        raise ModelError(f"its size is {width} x {height}")
    if not all(math.isfinite(number) for number in numbers):
        raise ModelError("its parameters are not finite")
    if model.focals == 0:
        return equirectangular(width, height)
    focal = (numbers[0], numbers[model.focals - 1])
    x, y, *rest = numbers[model.focals :]
    if min(focal) <= 0 or not (0 <= x <= width and 0 <= y <= height):
        raise ModelError(f"focal lengths {focal[0]:g} {focal[1]:g} and principal point {x:g} {y:g} make no sense")
    fields = model.fields(rest)
    if fields.get("projection") == "fov" and not 1e-6 < rest[0] < math.pi:
        fields = {} if abs(rest[0]) <= 1e-6 else _refused(f"its FOV angle is {rest[0]:g}")
    return Lens(width, height, focal, (x, y), **fields)


def _refused(reason: str) -> dict[str, Any]:
    raise ModelError(reason)
