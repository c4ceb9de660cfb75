"""Pixels that no image file holds: in an archive, a film, a stream, or in many files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int32, Shaped

from goc.errors import FileError
from goc.files import is_file, raster_size, read_bytes, read_codes, read_raster

_LARGEST = 1 << 28


@runtime_checkable
class Stored(Protocol):
    """Where pixels lie, and how to decode them when asked. Implementations are small frozen dataclasses.

    They hold paths and numbers, no open file, so that a capture can be sent to another process.
    """

    @property
    def path(self) -> Path:
        """The file that errors name; where it is missing, so are the pixels."""
        ...

    def size(self) -> tuple[int, int]:
        """Width and height, without decoding where that is possible."""
        ...

    def read(self) -> Shaped[np.ndarray, "..."]:
        """Decode.

        Returns:
            (h w 3) or, with alpha, (h w 4) uint8 for photographs; (h w) numbers for depth and confidence, in stored
            units; (h w) integers for ids and masks, where the greatest value of uint8 and uint16 is unlabelled.

        Raises:
            FileError: missing or damaged.
        """
        ...


Pixels = Path | Stored
"""An image file, or pixels stored elsewhere."""


def path_of(pixels: Pixels) -> Path:
    """The file that errors name."""
    return pixels if isinstance(pixels, Path) else pixels.path


def is_there(pixels: Pixels) -> bool:
    """Whether the file exists."""
    return is_file(path_of(pixels))


def size_of(pixels: Pixels) -> tuple[int, int]:
    """(width, height) as stored; raises FileError."""
    return raster_size(pixels) if isinstance(pixels, Path) else pixels.size()


def numbers_in(pixels: Pixels) -> Shaped[np.ndarray, "h w"]:
    """Depth or confidence in stored units; raises FileError."""
    return read_raster(pixels) if isinstance(pixels, Path) else pixels.read()


def codes_in(pixels: Pixels) -> Shaped[np.ndarray, "h w"]:
    """Ids as stored: uint8, uint16, or int32 for colours (r << 16 | g << 8 | b); raises FileError."""
    return read_codes(pixels) if isinstance(pixels, Path) else pixels.read()


@dataclass(frozen=True)
class RawNumbers:
    """Numbers by rows in a file without a header of its own."""

    path: Path
    width: int
    height: int
    dtype: str
    """As NumPy writes it: "<u2", "<f4"."""
    offset: int = 0
    """Bytes before the first number."""

    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.width, self.height

    def read(self) -> Shaped[np.ndarray, "h w"]:
        """Read them; raises FileError where the file is missing or too short."""
        kind = np.dtype(self.dtype)
        count = self.width * self.height
        data = read_bytes(self.path, _LARGEST)
        if len(data) < self.offset + count * kind.itemsize:
            needed = self.offset + count * kind.itemsize
            raise FileError(
                f"{self.path}: {len(data):,} bytes, but {self.width} x {self.height} numbers of {kind} take {needed:,}."
                " Copy it again."
            )
        return np.frombuffer(data, kind, count, self.offset).reshape(self.height, self.width)


@dataclass(frozen=True)
class ObjectMasks:
    """Ids of one view from one binary image an object, whatever is not 0; where they overlap, the last one counts."""

    masks: tuple[tuple[int, Path], ...]
    """Ids and images, of one size."""

    @property
    def path(self) -> Path:
        """The first of them."""
        return self.masks[0][1]

    def size(self) -> tuple[int, int]:
        """Width and height of the first of them."""
        return size_of(self.path)

    def read(self) -> Int32[np.ndarray, "h w"]:
        """Read them all; raises FileError."""
        width, height = self.size()
        ids = np.zeros((height, width), np.int32)
        for number, path in self.masks:
            covered = read_codes(path) > 0
            if covered.shape != ids.shape:
                raise FileError(
                    f"{path}: {covered.shape[1]} x {covered.shape[0]} pixels, but {self.path.name} has {width} x "
                    f"{height}. Write the masks of a view in one size."
                )
            ids[covered] = number
        return ids
