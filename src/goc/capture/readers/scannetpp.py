"""Reader of ScanNet++ scenes (Yeshwanth et al. 2023): photographs of a DSLR, or the video of an iPhone.

dslr/resized_images/DSC0001.JPG   dslr/resized_anon_masks/DSC0001.png (0 = anonymised)   dslr/colmap/*.txt (a fisheye)
iphone/rgb.mkv or rgb/frame_000000.jpg   iphone/depth.bin or depth/frame_000000.png (millimetres)   iphone/colmap/*.txt
scans/mesh_aligned_0.05.ply   segments.json   segments_anno.json

Both models are in the laser scan's world: metres, z up. Photographs have no depth of their own, and neither has ids:
they are seen on the scan, where it is there. A scene's dslr/ is read, or iphone/ where that folder is given or is the
only one.
"""

import math
import re
import struct
import zlib
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Int16

from goc.capture.config import CaptureConfig
from goc.capture.packed import Extent, PackedNumbers, Packing
from goc.capture.pixels import Pixels, numbers_in
from goc.capture.readers.colmap_model import ModelImage, model_file, read_cameras, read_images
from goc.capture.readers.labels import is_room
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import COLOUR, demand, numbered, posed, step_of, thinned, warn
from goc.capture.scan import Scan
from goc.capture.source import Lens, Source, View, complain
from goc.capture.video import unpacked_once, video_frames
from goc.errors import FileError
from goc.events import Listener
from goc.files import MILLIMETRES, is_file, is_folder, read_json, write_png
from goc.scene import ROOM, UNLABELLED

_PHONE_DEPTH = (192, 256)
_BLOCK = 1 << 20
_MESH = "mesh_aligned_0.05.ply"


class _Segments(msgspec.Struct):
    segIndices: list[int]  # noqa: N815 - the data set's spelling


class _Group(msgspec.Struct):
    objectId: int  # noqa: N815
    label: str
    segments: list[int]


class _Annotation(msgspec.Struct):
    segGroups: list[_Group]  # noqa: N815


def detect(path: Path) -> bool:
    """Whether `path` is a scene, or its dslr/ or iphone/."""
    return _part(path) is not None


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read the photographs, or the phone's video.

    Raises:
        FileError: a file is malformed, or nothing here can decode videos.
        CaptureError: a part is missing, or a pose is not rigid.
    """
    part = _part(path) or path
    model = part / "colmap"
    cameras, registered = model_file(model, "cameras"), model_file(model, "images")
    demand(part, "ScanNet++", [("colmap/cameras.txt", cameras is not None), ("colmap/images.txt", bool(registered))])
    lenses, images = read_cameras(cameras or model), read_images(registered or model)
    demand(part, "ScanNet++", [("registered images in colmap/images.txt", bool(images))])
    views = (
        _phone(part, images, lenses, config, notify) if _is_phone(part) else _dslr(part, images, lenses, config, notify)
    )
    placed = posed(model, views, notify)
    source = Source(path=part, views=placed, metric=True, up=(0.0, 0.0, 1.0), direction="world-to-camera")
    scans = next((folder for folder in (path / "scans", path.resolve().parent / "scans") if is_folder(folder)), None)
    return source if scans is None else _with_scan(source, scans, notify)


def _part(path: Path) -> Path | None:
    for folder in (path / "dslr", path / "iphone", path):
        holds = any(is_folder(folder / name) for name in ("resized_images", "resized_anon_masks"))
        if holds or any(is_file(folder / name) for name in ("rgb.mkv", "rgb.mp4", "pose_intrinsic_imu.json")):
            return folder if is_folder(folder / "colmap") or folder != path else None
    return None


def _is_phone(part: Path) -> bool:
    return not is_folder(part / "resized_images")


def _view(name: str, image: Pixels, item: ModelImage, lenses: dict[int, Lens]) -> View:
    pose = np.linalg.inv(item.cam_from_world())
    return View(name=name, lens=lenses[item.camera], world_from_cam=pose, image=image)


def _checked(part: Path, images: list[ModelImage], lenses: dict[int, Lens]) -> list[ModelImage]:
    alien = [item.name for item in images if item.camera not in lenses]
    if alien:
        where = part / "colmap"
        raise complain(where, alien, len(images), "images are of a camera that is not there", "Download it again.")
    return images


def _dslr(
    part: Path, images: list[ModelImage], lenses: dict[int, Lens], config: CaptureConfig, notify: Listener
) -> list[View]:
    views = []
    for item in thinned(_checked(part, images, lenses), config, notify):
        view = _view(f"resized_images/{item.name}", part / "resized_images" / item.name, item, lenses)
        mask = (part / "resized_anon_masks" / item.name).with_suffix(".png")
        views.append(replace(view, mask=mask if is_file(mask) else None))
    return views


def _phone(
    part: Path, images: list[ModelImage], lenses: dict[int, Lens], config: CaptureConfig, notify: Listener
) -> list[View]:
    found = {int(number[0]): item for item in images if (number := re.findall(r"\d+", item.name))}
    used = list(found)[:: step_of(len(found), config, notify)]
    _checked(part, [found[number] for number in used], lenses)
    stills = numbered(part / "rgb", COLOUR)
    video = next((file for name in ("rgb.mkv", "rgb.mp4") if is_file(file := part / name)), None)
    demand(part, "ScanNet++", [("rgb.mkv or rgb/", bool(stills) or video is not None)])
    step = math.gcd(*used) or 1
    frames = stills or video_frames(video or part, step, notify)
    lacking = [found[number].name for number in used if number not in frames]
    if lacking:
        raise complain(part, lacking, len(used), "registered images are not in the video", "Download it again.")
    depth, units = _phone_depth(part, used, notify) if config.use_depth else ({}, MILLIMETRES)
    masks = numbered(part / "rgb_masks", (".png",))
    return [
        replace(
            _view(f"rgb/frame_{number:06}.jpg", frames[number], found[number], lenses),
            depth=depth.get(number),
            depth_units_per_metre=units,
            mask=masks.get(number),
        )
        for number in used
    ]


def _phone_depth(part: Path, used: list[int], notify: Listener) -> tuple[dict[int, Pixels], float]:
    """Depth by number, and its steps in a metre."""
    extracted = numbered(part / "depth", (".png",))
    file = part / "depth.bin"
    if extracted or not is_file(file):
        return dict(extracted), MILLIMETRES
    pieces, units = _pieces(file)
    if pieces:
        return pieces, units
    step = math.gcd(*used) or 1
    folder = unpacked_once(file, f"depth {step}", partial(_inflate, file, step), notify)
    return dict(numbered(folder, (".png",))), MILLIMETRES


def _pieces(file: Path) -> tuple[dict[int, Pixels], float]:
    """Frames that are compressed one by one, each after its size; none where the whole file is one stream."""
    extents, at, size = [], 0, file.stat().st_size
    with file.open("rb") as stream:
        while at + 4 <= size:
            stream.seek(at)
            (length,) = struct.unpack("<I", stream.read(4))
            extents.append((at + 4, length))
            at += 4 + length
    if at != size or not extents:
        return {}, MILLIMETRES
    height, width = _PHONE_DEPTH
    made: list[tuple[Packing, str, int, float]] = [("deflate", "<f4", 4, 1.0), ("lz4", "<u2", 2, MILLIMETRES)]
    for packing, dtype, each, units in made:
        count = height * width * each
        pieces: dict[int, Pixels] = {
            number: PackedNumbers(Extent(file, f"frame {number}", start, length, count, packing), _PHONE_DEPTH, dtype)
            for number, (start, length) in enumerate(extents)
        }
        if packing == made[-1][0] or _is_readable(pieces[0]):
            return pieces, units
    return {}, MILLIMETRES


def _is_readable(pixels: Pixels) -> bool:
    try:
        numbers_in(pixels)
    except FileError:
        return False
    return True


def _inflate(file: Path, step: int, folder: Path) -> None:
    """Take every n-th depth image, in metres, out of one stream; only one is in memory at a time."""
    height, width = _PHONE_DEPTH
    size, number, held, stream = height * width * 4, 0, bytearray(), zlib.decompressobj(-zlib.MAX_WBITS)
    with file.open("rb") as packed:
        try:
            while data := stream.unconsumed_tail or packed.read(_BLOCK):
                held += stream.decompress(data, size)
                while len(held) >= size:
                    if number % step == 0:
                        metres = np.frombuffer(bytes(held[:size]), "<f4").reshape(height, width)
                        steps = np.nan_to_num(metres * 1000, nan=0, posinf=0, neginf=0).clip(0, 65534)
                        write_png(folder / f"frame_{number:06}.png", np.rint(steps).astype(np.uint16))
                    del held[:size]
                    number += 1
        except zlib.error as error:
            raise FileError(f"{file}: damaged ({error}). Download it again.") from error


def _with_scan(source: Source, scans: Path, notify: Listener) -> Source:
    if not is_file(scans / _MESH):
        warn(notify, f"no scans/{_MESH}: photographs have no depth and no ids")
        return source
    segments, annotation = scans / "segments.json", scans / "segments_anno.json"
    if not (is_file(segments) and is_file(annotation)):
        return replace(source, scan=Scan(scans / _MESH))
    groups = read_json(annotation, _Annotation).segGroups
    first = 1 if any(group.objectId <= 0 for group in groups) else 0
    numbers = {id(group): group.objectId + first for group in groups}
    ids = _vertex_ids(read_json(segments, _Segments).segIndices, groups, numbers)
    names = {numbers[id(group)]: group.label for group in groups if not is_room(group.label)}
    return replace(source, scan=Scan(scans / _MESH, ids), id_names=names)


def _vertex_ids(segments: list[int], groups: list[_Group], numbers: dict[int, int]) -> Int16[np.ndarray, "v"]:
    of_segment = {
        segment: ROOM if is_room(group.label) else numbers[id(group)] for group in groups for segment in group.segments
    }
    return np.array([of_segment.get(segment, UNLABELLED) for segment in segments], np.int16)


READER = Reader(name="ScanNet++", expects="dslr/ or iphone/ with colmap/ (ScanNet++)", detect=detect, read=read)
