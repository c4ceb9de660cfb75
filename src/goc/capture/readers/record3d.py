"""Reader of Record3D recordings: .r3d files, such a file unpacked, and its export as EXR and JPG.

.r3d is a ZIP archive: metadata (JSON), rgbd/0.jpg, rgbd/0.depth (LZFSE of float32 metres), rgbd/0.conf (LZFSE of bytes
0 to 2). The export has metadata.json, rgb/0.jpg and depth/0.exr. Poses are camera to world with OpenGL axes,
quaternion x y z w before the position; K is stored by columns. The world begins at the first camera; where `initPose`
tells how that stood in ARKit's world, y up, it tells which way is up.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from goc.capture.config import CaptureConfig
from goc.capture.packed import Extent, PackedNumbers, PackedPicture, Repacked, unpack, zip_extents
from goc.capture.pixels import size_of
from goc.capture.poses import OPENCV_FROM_OPENGL
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import COLOUR, demand, numbered, paired, posed, thinned
from goc.capture.source import Lens, Pixels, Source, View
from goc.errors import CaptureError, FileError
from goc.events import Listener
from goc.files import is_file, is_folder, read_bytes

_MEDIUM_CONFIDENCE = 1.0
_JSON_LIMIT = 256 << 20
_PIECE_LIMIT = 64 << 20
_MOST_DEPTH_BYTES = 4 * 1920 * 1440
_PORTRAIT_SIZES = ((192, 256), (480, 640), (720, 960))  # of LiDAR, and of FaceID on older and newer phones
_Part = TypeVar("_Part", bound=Pixels)


class _Metadata(msgspec.Struct):
    w: int
    h: int
    K: list[float]
    poses: list[list[float]]
    dw: int | None = None
    dh: int | None = None
    perFrameIntrinsicCoeffs: list[list[float]] = []  # noqa: N815 - Record3D's spelling
    initPose: list[float] = []  # noqa: N815


@dataclass(frozen=True)
class _Parts:
    """Files of a recording by number."""

    colour: dict[int, Pixels]
    depth: dict[int, Pixels]
    sure: dict[int, Pixels] = field(default_factory=dict)


def detect(path: Path) -> bool:
    """Whether `path` is a .r3d file, a folder with one, or a folder with what such a file or the export holds."""
    return _file(path) is not None or _exported(path) is not None or _is_unpacked(path)


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Find what is in a recording; images stay packed.

    Raises:
        FileError: the archive or its metadata are damaged.
        CaptureError: images or depth are missing, or a pose is not rigid.
    """
    file, exported = _file(path), _exported(path)
    if file is not None:
        pieces = zip_extents(file, lambda name: _piece(name) is not None or name.endswith("metadata"))
        stated = next((piece for name, piece in pieces.items() if name.endswith("metadata")), None)
        demand(file, "Record3D", [("metadata", stated is not None)])
        where, text = file, stated.read() if stated else b""
        metadata = _metadata(where, text)
        parts = _of_pieces({name: piece for name, piece in pieces.items() if _piece(name)}, metadata)
    elif exported is not None:
        where = exported / "metadata.json"
        demand(exported, "Record3D", [("metadata.json", is_file(where)), ("rgb/", is_folder(exported / "rgb"))])
        metadata = _metadata(where, read_bytes(where, _JSON_LIMIT))
        parts = _Parts(dict(numbered(exported / "rgb", COLOUR)), dict(numbered(exported / "depth", (".exr",))))
    else:
        where = path / "metadata"
        metadata = _metadata(where, read_bytes(where, _JSON_LIMIT))
        parts = _of_pieces(_files(path), metadata)
    return _source(where, metadata, parts, config, notify)


def _file(path: Path) -> Path | None:
    if is_file(path):
        return path if path.suffix.lower() == ".r3d" else None
    files = sorted(path.glob("*.r3d")) if is_folder(path) else []
    return files[0] if len(files) == 1 else None


def _exported(path: Path) -> Path | None:
    for folder in (path, path / "EXR_RGBD"):
        depth = numbered(folder / "depth", (".exr",))
        if (is_file(folder / "metadata.json") and is_folder(folder / "rgb")) or depth:
            return folder
    return None


def _is_unpacked(path: Path) -> bool:
    return is_folder(path / "rgbd") and is_file(path / "metadata")


def _piece(name: str) -> re.Match[str] | None:
    return re.fullmatch(r"(?:.*/)?rgbd/(\d+)\.(jpg|jpeg|png|depth|conf)", name)


def _files(path: Path) -> dict[str, Extent]:
    """Pieces that are files of their own."""
    found = {}
    for file in sorted((path / "rgbd").iterdir()):
        name = f"rgbd/{file.name}"
        if _piece(name):
            size = file.stat().st_size
            found[name] = Extent(file, "", 0, size, size)
    return found


def _metadata(where: Path, text: bytes) -> _Metadata:
    try:
        metadata = msgspec.json.decode(text, type=_Metadata)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{where}: its metadata are no JSON of Record3D ({error}). Export it again.") from error
    whole = len(metadata.K) == 9 and all(len(pose) == 7 for pose in metadata.poses) and metadata.poses
    lenses = all(len(numbers) == 4 for numbers in metadata.perFrameIntrinsicCoeffs)
    if not (whole and lenses and metadata.w > 0 and metadata.h > 0):
        raise CaptureError(f"{where}: K, poses, w or h of its metadata are not whole. Export it again.")
    return metadata


def _of_pieces(pieces: dict[str, Extent], metadata: _Metadata) -> _Parts:
    kinds: dict[str, dict[int, Extent]] = {"colour": {}, "depth": {}, "conf": {}}
    for name, piece in pieces.items():
        found = _piece(name)
        if found:
            kind = found[2] if found[2] in ("depth", "conf") else "colour"
            kinds[kind][int(found[1])] = piece
    depth = dict(sorted(kinds["depth"].items()))
    if not depth:
        return _Parts(_all(kinds["colour"], PackedPicture), {})
    width, height = _depth_size(metadata, next(iter(depth.values())))
    numbers = _numbers(width, height)
    return _Parts(
        _all(kinds["colour"], PackedPicture), _all(depth, numbers("<f4", 4)), _all(kinds["conf"], numbers("u1", 1))
    )


def _all(pieces: dict[int, Extent], make: Callable[[Extent], _Part]) -> dict[int, Pixels]:
    return {number: make(piece) for number, piece in sorted(pieces.items())}


def _numbers(width: int, height: int) -> Callable[[str, int], Callable[[Extent], PackedNumbers]]:
    def of_type(dtype: str, each: int) -> Callable[[Extent], PackedNumbers]:
        size = width * height * each
        return lambda piece: PackedNumbers(Repacked(piece, size, "lzfse"), (height, width), dtype)

    return of_type


def _depth_size(metadata: _Metadata, first: Extent) -> tuple[int, int]:
    """Width and height: stated, or for older recordings the sensor's of the first image's number of bytes."""
    if metadata.dw is not None and metadata.dh is not None and metadata.dw > 0 and metadata.dh > 0:
        return metadata.dw, metadata.dh
    count = len(unpack(first.label, "lzfse", first.read(), _MOST_DEPTH_BYTES)) // 4
    for width, height in _PORTRAIT_SIZES:
        if width * height == count:
            return (width, height) if metadata.h >= metadata.w else (height, width)
    raise CaptureError(f"{first.label}: {count} depth values, of no known sensor. Export it with a newer Record3D.")


def _source(where: Path, metadata: _Metadata, parts: _Parts, config: CaptureConfig, notify: Listener) -> Source:
    demand(where, "Record3D", [("colour images", bool(parts.colour))])
    within = {number: number for number in range(len(metadata.poses))}
    names = {number: Path(f"rgb/{number}") for number in parts.colour}
    numbers = thinned(paired(where, names, within, "pose", config, notify), config, notify)
    size = size_of(parts.colour[numbers[0]])
    views = [
        View(
            name=f"rgb/{number}",
            lens=_lens(where, metadata, number).resized(*size),
            world_from_cam=_pose(metadata.poses[number]) @ OPENCV_FROM_OPENGL,
            image=parts.colour[number],
            depth=parts.depth.get(number),
            confidence=parts.sure.get(number) if number in parts.depth else None,
        )
        for number in numbers
    ]
    up = None
    if len(metadata.initPose) == 7:
        x, y, z = (_pose(metadata.initPose)[:3, :3].T @ [0.0, 1.0, 0.0]).tolist()
        up = (x, y, z)
    return Source(
        axes="opengl",
        path=where,
        views=posed(where, views, notify),
        depth_units_per_metre=1.0,
        least_confidence=_MEDIUM_CONFIDENCE,
        metric=True,
        up=up,
    )


def _pose(numbers: list[float]) -> Float64[np.ndarray, "4 4"]:
    matrix = np.full((4, 4), np.nan)
    if np.isfinite(numbers).all() and np.linalg.norm(numbers[:4]) > 0.5:
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(numbers[:4]).as_matrix()
        matrix[:3, 3] = numbers[4:]
    return matrix


def _lens(where: Path, metadata: _Metadata, number: int) -> Lens:
    own = metadata.perFrameIntrinsicCoeffs
    k = metadata.K
    fx, fy, cx, cy = own[number] if number < len(own) else (k[0], k[4], k[6], k[7])
    if not (fx > 0 and fy > 0):
        raise CaptureError(f"{where}: focal lengths {fx:g} and {fy:g} of frame {number}. Export it again.")
    return Lens(metadata.w, metadata.h, (fx, fy), (cx, cy))


READER = Reader(
    name="Record3D", expects="a .r3d file, or its export as EXR and JPG (Record3D)", detect=detect, read=read
)
