"""Points as surveyors keep them: LAS, and LAZ, which needs the extra `formats` (ASPRS LAS 1.4 R15)."""

import io
import struct
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from goc.errors import FileError
from goc.files.raw_points import RawPoints
from goc.files.reading import brief, read_bytes

MOST_POINTS = 50_000_000
"""More than any object has."""

_LIMIT = 4 << 30
_COLOURS_AT = {2: 20, 3: 28, 5: 28, 7: 30, 8: 30, 10: 30}
"""Where red is in a point of a format that has colours."""
_LEAST = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
"""Bytes of a point, by format."""
_VLR, _PACKER = 54, (b"laszip encoded", 22204)
_CHUNK = 1 << 20


def read_las(path: Path) -> RawPoints:
    """Read .las or .laz: positions with their scale and offset in double precision, colours where there are any.

    Raises:
        FileError: missing, damaged, of more points than an object has, or packed and the extra is not installed.
    """
    data = read_bytes(path, _LIMIT)
    try:
        return _points(path, data)
    except (struct.error, ValueError, IndexError) as error:
        raise FileError(f"{path}: not a readable LAS file ({brief(error)}). Write it again.") from error


def _points(path: Path, data: bytes) -> RawPoints:
    if data[:4] != b"LASF":
        raise ValueError("it does not begin with LASF")
    size, start, vlrs, kind, width, count = struct.unpack_from("<HIIBHI", data, 94)
    if data[24] == 1 and data[25] >= 4:
        (count,) = struct.unpack_from("<Q", data, 247)
    packed, kind = kind & 0xC0, kind & 0x3F
    if kind >= len(_LEAST) or width < _LEAST[kind]:
        raise ValueError(f"points of format {kind} in {width} bytes each")
    check_count(path, count)
    if packed:
        rows = _unpacked(path, data, _packing(data, size, vlrs, start), (start, count, width))
    elif start + count * width > len(data):
        raise ValueError(f"cut short: {count:,} points need {start + count * width:,} bytes, {len(data):,} are there")
    else:
        rows = np.frombuffer(data, np.uint8, count * width, start).reshape(count, width)
    scale, offset = np.frombuffer(data, "<f8", 3, 131), np.frombuffer(data, "<f8", 3, 155)
    with np.errstate(over="ignore", invalid="ignore"):
        places = np.ascontiguousarray(rows[:, :12]).view("<i4") * scale + offset
    at = _COLOURS_AT.get(kind)
    colours = None if at is None else np.ascontiguousarray(rows[:, at : at + 6]).view("<u2")
    return RawPoints(positions=places, colours=colours)


def _packing(data: bytes, at: int, vlrs: int, stop: int) -> bytes:
    """What the writer of a .laz tells of how it packed."""
    for _ in range(vlrs):
        if at + _VLR > min(stop, len(data)):
            break
        user, record, length = struct.unpack_from("<2x16sHH", data, at)
        if (user.rstrip(b"\0"), record) == _PACKER:
            return data[at + _VLR : at + _VLR + length]
        at += _VLR + length
    raise ValueError("packed, but not told how")


def _unpacked(path: Path, data: bytes, packing: bytes, layout: tuple[int, int, int]) -> UInt8[np.ndarray, "p w"]:
    """The rows of a .laz, a million at a time, so that what is not there takes no memory."""
    try:
        import lazrs  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise FileError(f"{path}: .laz is read by an extra. Run `pip install goc[formats]`, or write .las.") from error
    start, count, width = layout
    parts, source = [np.zeros((0, width), np.uint8)], io.BytesIO(data)
    source.seek(start)
    try:
        reader = lazrs.LasZipDecompressor(source, packing)
        for first in range(0, count, _CHUNK):
            part = np.zeros((min(_CHUNK, count - first), width), np.uint8)
            reader.decompress_many(part.reshape(-1))
            parts.append(part)
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":  # Rust's is no Exception
            raise
        raise ValueError(f"it cannot be unpacked: {error}") from error
    return np.concatenate(parts)


def check_count(path: Path, count: int) -> None:
    """Refuse (FileError) more points than an object has."""
    if count > MOST_POINTS:
        raise FileError(f"{path}: {count:,} points, but an object has at most {MOST_POINTS:,}. Cut it out first.")
