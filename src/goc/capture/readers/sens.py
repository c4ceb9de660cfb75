"""Reader of ScanNet's .sens recordings: colour, depth and poses of a scan in one file, unpacked as if exported.

Little endian. u32 version 4; u64 and name of the sensor; four 4 x 4 float32 (intrinsics and extrinsics of colour, of
depth); i32 how colour and depth are compressed; u32 widths and heights; f32 depth steps in a metre; u64 frames. Each
frame: 4 x 4 float32 camera to world; u64 times of both; u64 sizes of both; the bytes. IMU frames follow.
"""

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float32, UInt16

from goc.capture.config import CaptureConfig
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import step_of
from goc.capture.readers.scannet import read_exported
from goc.capture.source import Source
from goc.capture.unpack import unpacked
from goc.errors import CaptureError, FileError
from goc.events import Listener, Progress
from goc.files import MILLIMETRES, is_file, is_folder, write_png

_VERSION = 4
_RAW, _PNG, _JPEG = 0, 1, 2
_ZLIB = 1
_MOST_PIXELS = 89_000_000
_FRAME = struct.Struct("<16f4Q")
_LONGEST_NAME = 4096


@dataclass(frozen=True, eq=False)
class _Header:
    intrinsics: Float32[np.ndarray, "4 4"]
    colour_codec: int
    depth_codec: int
    colour_size: tuple[int, int]
    depth_size: tuple[int, int]
    steps_per_metre: float
    count: int


def detect(path: Path) -> bool:
    """Whether `path` is a .sens file, or a folder with one."""
    return _file(path) is not None


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Unpack a recording, or those of its frames that are used, and read it with the annotations that lie beside it.

    Raises:
        FileError: the file is damaged, or the disk is full.
        CaptureError: it has another version or compression, or a pose is finite and not rigid.
    """
    file = _file(path) or path
    with _opened(file) as stream:
        header = _header(file, stream)
        start = stream.tell()
    step = step_of(header.count, config, notify)
    fill = partial(_unpack, file, header, start, step, notify)
    size = file.stat().st_size * 2 // step  # depth grows: PNG packs it less well than the recording's
    folder = unpacked(file, fill, notify, kind=f"one in {step}", size=size)
    source = read_exported(folder, file.parent, replace(config, every=1), notify)
    return replace(source, path=file)


def _file(path: Path) -> Path | None:
    if is_file(path):
        return path if path.suffix.lower() == ".sens" else None
    files = sorted(path.glob("*.sens")) if is_folder(path) else []
    return files[0] if len(files) == 1 else None


def _opened(file: Path) -> BinaryIO:
    try:
        return file.open("rb")
    except OSError as error:
        raise FileError(f"{file}: cannot be read ({error.strerror}). Check the path.") from error


def _take(file: Path, stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise FileError(f"{file}: ends in the middle of a frame. Copy it again.")
    return data


def _header(file: Path, stream: BinaryIO) -> _Header:
    version, length = struct.unpack("<IQ", _take(file, stream, 12))
    if version != _VERSION or length > _LONGEST_NAME:
        raise CaptureError(f"{file}: version {version} of .sens, not {_VERSION}. Download or export it again.")
    _take(file, stream, length)
    matrices = np.frombuffer(_take(file, stream, 256), "<f4").reshape(4, 4, 4)
    codecs = struct.unpack("<2i", _take(file, stream, 8))
    cw, ch, dw, dh, steps, count = struct.unpack("<4IfQ", _take(file, stream, 28))
    if codecs[0] not in (_RAW, _PNG, _JPEG) or codecs[1] not in (_RAW, _ZLIB):
        text = f"{file}: colour is compressed by method {codecs[0]} and depth by {codecs[1]}, which goc does not know"
        raise CaptureError(f"{text}. Export the scene with ScanNet's SensReader.")
    if not (0 < cw * ch <= _MOST_PIXELS and 0 <= dw * dh <= _MOST_PIXELS and 0 < steps < np.inf):
        raise FileError(f"{file}: sizes {cw} x {ch} and {dw} x {dh}, {steps:g} steps a metre. The file is damaged.")
    left = file.stat().st_size - stream.tell()
    if not 0 < count <= left // _FRAME.size:
        raise FileError(f"{file}: {count:,} frames in {left:,} bytes. The file is cut short or damaged.")
    return _Header(matrices[0], *codecs, (cw, ch), (dw, dh), steps, count)


def _unpack(file: Path, header: _Header, start: int, step: int, notify: Listener, folder: Path) -> None:
    """Write every n-th frame as ScanNet's own exporter does."""
    for name in ("color", "depth", "pose", "intrinsic"):
        (folder / name).mkdir()
    np.savetxt(folder / "intrinsic" / "intrinsic_color.txt", header.intrinsics)
    with _opened(file) as stream:
        stream.seek(start)
        for number in range(header.count):
            *pose, _, _, colour, depth = _FRAME.unpack(_take(file, stream, _FRAME.size))
            if colour + depth > 16 * _MOST_PIXELS:
                raise FileError(f"{file}: frame {number} has {colour + depth:,} bytes. The file is damaged.")
            if number % step:
                stream.seek(colour + depth, 1)
                continue
            _write_colour(file, header, _take(file, stream, colour), folder / "color" / str(number))
            if depth:
                values = _depth(file, header, _take(file, stream, depth))
                write_png(folder / "depth" / f"{number}.png", values)
            np.savetxt(folder / "pose" / f"{number}.txt", np.reshape(pose, (4, 4)))
            notify(Progress(stage="capture", done=number + 1, total=header.count))


def _write_colour(file: Path, header: _Header, data: bytes, target: Path) -> None:
    width, height = header.colour_size
    if header.colour_codec != _RAW:
        target.with_suffix(".jpg" if header.colour_codec == _JPEG else ".png").write_bytes(data)
    elif len(data) == width * height * 3:
        write_png(target.with_suffix(".png"), np.frombuffer(data, np.uint8).reshape(height, width, 3))
    else:
        raise FileError(f"{file}: an image of {len(data):,} bytes is not {width} x {height}. The file is damaged.")


def _depth(file: Path, header: _Header, data: bytes) -> UInt16[np.ndarray, "h w"]:
    width, height = header.depth_size
    unpack: Callable[[bytes], bytes] = _bounded(width * height * 2) if header.depth_codec == _ZLIB else bytes
    try:
        values = np.frombuffer(unpack(data), "<u2").reshape(height, width)
    except (zlib.error, ValueError) as error:
        raise FileError(f"{file}: a depth image is damaged ({error}). Copy it again.") from error
    if header.steps_per_metre == MILLIMETRES:
        return values
    scaled = np.rint(values * (MILLIMETRES / header.steps_per_metre))
    return np.where(scaled <= np.iinfo(np.uint16).max, scaled, 0).astype(np.uint16)


def _bounded(size: int) -> Callable[[bytes], bytes]:
    return lambda data: zlib.decompressobj().decompress(data, size + 1)


READER = Reader(name="ScanNet .sens", expects="a .sens recording (ScanNet)", detect=detect, read=read)
