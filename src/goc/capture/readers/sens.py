"""Reader of ScanNet's .sens recordings: colour, depth and poses of a scan in one file, decoded where they lie.

Little endian. u32 version 4; u64 and name of the sensor; four 4 x 4 float32 (intrinsics and extrinsics of colour, of
depth); i32 how colour and depth are compressed; u32 widths and heights; f32 depth steps in a metre; u64 frames. Each
frame: 4 x 4 float32 camera to world; u64 times of both; u64 sizes of both; the bytes. IMU frames follow.
"""

import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float32

from goc.capture.config import CaptureConfig
from goc.capture.packed import Extent, PackedNumbers, PackedPicture, Packing
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import CENTRE, step_of
from goc.capture.readers.scannet import annotated
from goc.capture.source import Lens, Source, Stored, View
from goc.errors import CaptureError, FileError
from goc.events import Listener
from goc.files import is_file, is_folder

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
    """Find the frames of a recording that are used, and the annotations that lie beside it; images stay packed.

    Raises:
        FileError: the file is damaged.
        CaptureError: it has another version or compression, or a pose is finite and not rigid.
    """
    file = _file(path) or path
    with _opened(file) as stream:
        header = _header(file, stream)
        step = step_of(header.count, config, notify)
        views = _views(file, stream, header, step)
    source = Source(path=file, views=(), depth_units_per_metre=header.steps_per_metre, metric=True, up=(0.0, 0.0, 1.0))
    return annotated(source, views, file.parent, config, notify)


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


def _views(file: Path, stream: BinaryIO, header: _Header, step: int) -> dict[int, View]:
    """Every n-th frame, by number; the stream stands before the first."""
    width, height = header.colour_size
    (fx, fy), (cx, cy) = np.diag(header.intrinsics)[:2].tolist(), header.intrinsics[:2, 2].tolist()
    if not (fx > 0 and fy > 0):
        raise FileError(f"{file}: focal lengths {fx:g} and {fy:g}. The file is damaged.")
    lens = Lens(width, height, (fx, fy), (cx + CENTRE, cy + CENTRE))
    views = {}
    for number in range(header.count):
        *pose, _, _, colour, depth = _FRAME.unpack(_take(file, stream, _FRAME.size))
        start = stream.tell()
        if colour + depth > file.stat().st_size - start:
            raise FileError(f"{file}: ends in the middle of frame {number} of {header.count}. Copy it again.")
        if number % step == 0:
            views[number] = View(
                name=f"color/{number}",
                lens=lens,
                world_from_cam=np.array(pose, np.float64).reshape(4, 4),
                image=_image(file, header, number, start, colour),
                depth=_depth(file, header, number, start + colour, depth) if depth else None,
            )
        stream.seek(start + colour + depth)
    return views


def _image(file: Path, header: _Header, number: int, start: int, length: int) -> Stored:
    extent = Extent(file, f"color {number}", start, length, length)
    if header.colour_codec != _RAW:
        return PackedPicture(extent)
    width, height = header.colour_size
    return PackedNumbers(replace(extent, size=width * height * 3), (height, width, 3), "u1")


def _depth(file: Path, header: _Header, number: int, start: int, length: int) -> Stored:
    width, height = header.depth_size
    packing: Packing = "zlib" if header.depth_codec == _ZLIB else "none"
    extent = Extent(file, f"depth {number}", start, length, width * height * 2, packing)
    return PackedNumbers(extent, (height, width), "<u2")


READER = Reader(name="ScanNet .sens", expects="a .sens recording (ScanNet)", detect=detect, read=read)
