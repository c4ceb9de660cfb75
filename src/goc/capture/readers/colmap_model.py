"""COLMAP's cameras, images and points3D, .bin or .txt (https://colmap.github.io/format.html)."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from goc.capture.colmap_lens import BY_NAME, MODELS, ModelError, lens_of_model
from goc.capture.source import FarPoints, Lens, shown
from goc.errors import CaptureError, FileError
from goc.files import is_file, read_bytes

_LIMIT = 1 << 32
_POINT = 24
"""Bytes of a point in an image: x, y, and the number of its point in space."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelImage:
    """One registered image."""

    name: str
    camera: int
    quaternion: tuple[float, float, float, float]
    """w x y z, of cam_from_world."""
    translation: tuple[float, float, float]

    def cam_from_world(self) -> Float64[np.ndarray, "4 4"]:
        """The pose as a matrix; the quaternion's length is divided out."""
        w, x, y, z = np.array(self.quaternion) / np.linalg.norm(self.quaternion)
        matrix = np.eye(4)
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        matrix[:3, 3] = self.translation
        return matrix


def model_file(folder: Path, stem: str) -> Path | None:
    """cameras, images or points3D: .bin wins where both exist."""
    return next((path for path in (folder / f"{stem}.bin", folder / f"{stem}.txt") if is_file(path)), None)


def read_cameras(path: Path) -> dict[int, Lens]:
    """Lenses by camera id.

    Raises:
        FileError: missing, malformed or cut short.
        CaptureError: an unknown camera model, or numbers that make no sense.
    """
    found = {}
    entries = _parsed(path, _cameras_text if path.suffix == ".txt" else _cameras_bytes)
    for number, model, width, height, numbers in entries:
        known = BY_NAME.get(model) if isinstance(model, str) else MODELS.get(model)
        if known is None:
            raise CaptureError(
                f"{path}: camera {number} is of model {shown(str(model))}, which goc does not know. Convert it with"
                " colmap image_undistorter."
            )
        try:
            found[number] = lens_of_model(known, width, height, numbers)
        except ModelError as error:
            raise CaptureError(f"{path}: camera {number}: {error}. Check the file.") from error
    return found


def read_images(path: Path) -> list[ModelImage]:
    """Registered images in the order of their names; raises FileError."""
    entries = _parsed(path, _images_text if path.suffix == ".txt" else _images_bytes)
    images = [
        ModelImage(name=name, camera=camera, quaternion=(*quaternion,), translation=(*translation,))
        for quaternion, translation, camera, name in entries
    ]
    return sorted(images, key=lambda image: image.name)


def count_images(path: Path) -> int:
    """How many images a model has registered; raises FileError."""
    return len(_parsed(path, _images_text if path.suffix == ".txt" else _images_bytes))


def read_model_points(path: Path) -> FarPoints | None:
    """The sparse points; None where there are none. Raises FileError."""
    rows = _parsed(path, _points_text if path.suffix == ".txt" else _points_bytes)
    if not rows:
        return None
    numbers = np.array(rows, np.float64)
    kept = np.isfinite(numbers[:, :3]).all(1)
    colours = numbers[kept, 3:].clip(0, 255).astype(np.uint8)
    return FarPoints(positions=np.ascontiguousarray(numbers[kept, :3]), colours=np.ascontiguousarray(colours))


def _parsed(path: Path, parse: Callable[[bytes], list[Any]]) -> list[Any]:
    data = read_bytes(path, _LIMIT)
    try:
        return parse(data)
    except (ValueError, IndexError, struct.error, UnicodeDecodeError) as error:
        raise FileError(f"{path}: damaged or cut short ({error}). Copy it again.") from error


class _Bytes:
    """Reads one number after the other; counts are believed only as far as there are bytes."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def take(self, layout: str) -> tuple[Any, ...]:
        values = struct.unpack_from("<" + layout, self._data, self._at)
        self._at += struct.calcsize("<" + layout)
        return values

    def count(self, least: int) -> int:
        """A number of items of at least so many bytes."""
        (count,) = self.take("Q")
        if count * least > len(self._data) - self._at:
            raise ValueError(f"{count} entries do not fit into the file")
        return count

    def skip(self, size: int) -> None:
        if size > len(self._data) - self._at:
            raise ValueError(f"{size} bytes do not fit into the file")
        self._at += size

    def text(self) -> str:
        end = self._data.index(b"\0", self._at)
        text = self._data[self._at : end].decode()
        self._at = end + 1
        return text


def _cameras_bytes(data: bytes) -> list[Any]:
    file = _Bytes(data)
    cameras = []
    for _ in range(file.count(40)):
        number, model, width, height = file.take("IiQQ")
        if model not in MODELS:
            return [(number, model, width, height, ())]  # how long it is nobody knows: reported by the caller
        cameras.append((number, model, width, height, file.take(f"{MODELS[model].count}d")))
    return cameras


def _images_bytes(data: bytes) -> list[Any]:
    file = _Bytes(data)
    images = []
    for _ in range(file.count(73)):
        _, *numbers, camera = file.take("I7dI")
        name = file.text()
        file.skip(_POINT * file.count(_POINT))
        images.append((numbers[:4], numbers[4:], camera, name))
    return images


def _points_bytes(data: bytes) -> list[Any]:
    file = _Bytes(data)
    points = []
    for _ in range(file.count(51)):
        values = file.take("Q3d3Bd")
        file.skip(8 * file.count(8))
        points.append(values[1:7])
    return points


def _lines(data: bytes) -> Iterator[str]:
    return (line for line in data.decode().splitlines() if not line.lstrip().startswith("#"))


def _cameras_text(data: bytes) -> list[Any]:
    cameras = []
    for line in _lines(data):
        if line.strip():
            number, model, width, height, *numbers = line.split()
            cameras.append((int(number), model, int(width), int(height), tuple(map(float, numbers))))
    return cameras


def _images_text(data: bytes) -> list[Any]:
    """Two lines an image; the second one, its points, may be empty."""
    images = []
    lines = _lines(data)
    for line in lines:
        if not line.strip():
            continue
        words = line.split(maxsplit=9)
        numbers = [float(word) for word in words[1:8]]
        images.append((numbers[:4], numbers[4:], int(words[8]), words[9].strip()))
        next(lines, None)
    return images


def _points_text(data: bytes) -> list[Any]:
    return [tuple(map(float, line.split(maxsplit=7)[1:7])) for line in _lines(data) if line.strip()]
