"""Numbers by pixel, as depth and confidence are stored: image files, NumPy arrays, OpenEXR and PFM."""

import io
import os
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Shaped
from numpy.lib.npyio import NpzFile

from goc.errors import FileError
from goc.files.images import MILLIMETRES, image_size, read_channel
from goc.files.reading import brief, read_bytes, unreadable

_LIMIT = 1 << 30
_DEPTH_CHANNELS = ("Z", "depth", "Depth", "Y", "R", "V")
_NPZ_NAMES = ("depth", "arr_0", "data", "pred", "conf", "confidence")


def raster_size(path: Path) -> tuple[int, int]:
    """(width, height) of what `read_raster` reads, from the header alone where the format has one."""
    match path.suffix.lower():
        case ".npy":
            height, width = _open_npy(path).shape[:2]
        case ".npz" | ".exr" | ".pfm":
            height, width = read_raster(path).shape
        case _:
            return image_size(path)
    return width, height


def read_raster(path: Path) -> Shaped[np.ndarray, "h w"]:
    """Read one number a pixel, as stored: .npy, .npz, .exr (extra goc[formats]), .pfm, or a grey image, TIFF included.

    Raises:
        FileError: missing, damaged, not a single channel, or a library is not installed.
    """
    match path.suffix.lower():
        case ".npy":
            return np.array(_open_npy(path)).reshape(_open_npy(path).shape[:2])
        case ".npz":
            return _read_npz(path)
        case ".exr":
            return _read_exr(path)
        case ".pfm":
            return _read_pfm(path)
        case _:
            return read_channel(path, "a depth image")


def read_depth(path: Path, units_per_metre: float = MILLIMETRES) -> Float32[np.ndarray, "h w"]:
    """Read a depth image: metres, NaN = none; see `read_raster` and `depth_of`."""
    return depth_of(read_raster(path), units_per_metre, saturates=False)


def depth_of(
    stored: Shaped[np.ndarray, "h w"], units_per_metre: float, saturates: bool = True
) -> Float32[np.ndarray, "h w"]:
    """Stored numbers as metres in float32; NaN = none.

    Args:
        stored: 0, and anything not finite or negative, means none.
        units_per_metre: steps of the stored numbers in a metre.
        saturates: 65535 of 16 bits means none too, as sensors write it.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        metres = stored.astype(np.float32) * np.float32(1.0 / units_per_metre)
        known = np.isfinite(metres) & (metres > 0)
    if saturates and stored.dtype == np.uint16:
        known &= stored < np.iinfo(np.uint16).max
    return np.where(known, metres, np.float32(np.nan))


def _open_npy(path: Path) -> Shaped[np.ndarray, "..."]:
    try:
        values = np.lib.format.open_memmap(path, mode="r")  # no pickles; checks the shape against the file's size
    except OSError as error:
        raise unreadable(path, error) from error
    except Exception as error:  # its header parser raises whatever Python's does
        raise FileError(f"{path}: not a readable .npy file ({brief(error)}). Write it again.") from error
    return _one_channel(path, values)


def _one_channel(path: Path, values: Shaped[np.ndarray, "..."]) -> Shaped[np.ndarray, "..."]:
    """(h w) or (h w 1); (1 h w) becomes (h w)."""
    if values.ndim == 3 and values.shape[0] == 1:
        values = values[0]
    if values.dtype.kind not in "uif" or values.ndim not in (2, 3) or values.ndim == 3 and values.shape[2] != 1:
        raise FileError(
            f"{path}: expected an array (h w) of numbers, found {values.shape} {values.dtype}. Write it again."
        )
    return values


def _read_npz(path: Path) -> Shaped[np.ndarray, "h w"]:
    data = io.BytesIO(read_bytes(path, _LIMIT))
    try:
        loaded = np.load(data, allow_pickle=False)
        arrays = dict(loaded) if isinstance(loaded, NpzFile) else {}
    except Exception as error:  # zipfile and NumPy raise a dozen types
        raise FileError(f"{path}: not a readable .npz file ({brief(error)}). Write it again.") from error
    named = [name for name in _NPZ_NAMES if name in arrays] or list(arrays)[: len(arrays) == 1]
    if not named:
        held = ", ".join(sorted(arrays)[:6]) or "nothing"
        raise FileError(f"{path}: holds {held}, no array named {_NPZ_NAMES[0]}. Name it so.")
    values = _one_channel(path, arrays[named[0]])
    return values.reshape(values.shape[:2])


def _read_pfm(path: Path) -> Shaped[np.ndarray, "h w"]:
    data = read_bytes(path, _LIMIT)
    try:
        kind, size, scale, body = data.split(b"\n", 3)
        width, height = (int(number) for number in size.split())
        values = np.frombuffer(body, "<f4" if float(scale) < 0 else ">f4")
        if kind.strip() != b"Pf" or values.size != width * height:
            raise ValueError("not one channel, or of another size than it says")
    except ValueError as error:
        raise FileError(f"{path}: not a readable .pfm file ({brief(error)}). Write it again.") from error
    return values.reshape(height, width)[::-1].astype(np.float32)


def _read_exr(path: Path) -> Shaped[np.ndarray, "h w"]:
    try:
        import OpenEXR  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise FileError(f"{path}: OpenEXR is not installed. pip install 'goc[formats]'.") from error
    read_bytes(path, _LIMIT)  # says what is wrong with the file itself
    try:
        with OpenEXR.File(os.fspath(path), separate_channels=True) as file:
            channels: dict[str, Any] = {name: item.pixels for name, item in file.channels().items()}
    except Exception as error:  # the C++ library's own errors
        raise FileError(f"{path}: not a readable .exr file ({brief(error)}). Write it again.") from error
    named = [name for name in _DEPTH_CHANNELS if name in channels] or list(channels)[: len(channels) == 1]
    if not named:
        raise FileError(f"{path}: has channels {', '.join(sorted(channels)[:6])}, none of depth. Write it as Z.")
    return np.asarray(channels[named[0]], np.float32)
