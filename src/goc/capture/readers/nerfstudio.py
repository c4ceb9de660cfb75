"""Reader of nerfstudio's transforms.json, and of its ancestor from instant-ngp.

Camera axes in the file are OpenGL's; https://docs.nerf.studio/quickstart/data_conventions.html describes the format.
"""

import math
from pathlib import Path

import numpy as np

from goc.capture.config import CaptureConfig
from goc.capture.intrinsics import Intrinsics, LensError, lens_of
from goc.capture.poses import OPENCV_FROM_OPENGL, PoseError, rigid
from goc.capture.readers.reader import Reader
from goc.capture.source import Source, View, complain, count_of, parse_id_names, shown
from goc.errors import CaptureError
from goc.events import Listener, Warned
from goc.files import is_file, is_folder, read_json, read_points
from goc.scene import DepthKind

_ID_FOLDERS = ("instance", "instance_mask", "object_mask")
_SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")


class _Entry(Intrinsics, kw_only=True):
    file_path: str
    transform_matrix: list[list[float]]
    depth_file_path: str | None = None
    normal_file_path: str | None = None
    instance_file_path: str | None = None
    mask_path: str | None = None


class _Transforms(Intrinsics, kw_only=True):
    frames: list[_Entry]
    depth_unit_scale_factor: float = 0.001
    depth_kind: DepthKind = "metric"
    ply_file_path: str | None = None


def detect(path: Path) -> bool:
    """Whether `path` is a JSON file, or a folder with transforms.json."""
    return (is_file(path) and path.suffix == ".json") or (is_folder(path) and is_file(path / "transforms.json"))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a transforms.json (or that of a folder) and what lies beside it: labels.json, seed points, a folder of ids.

    Raises:
        FileError: the JSON, labels.json or the point file is malformed.
        CaptureError: a pose is not rigid, or a camera model is unknown or lacks numbers.
    """
    path = path if is_file(path) else path / "transforms.json"
    document = read_json(path, _Transforms)
    if not 0 < document.depth_unit_scale_factor < math.inf:
        given = document.depth_unit_scale_factor
        raise CaptureError(
            f"{path}: depth_unit_scale_factor is {given:g}. Give the metres of one depth step, such as 0.001."
        )
    masked = sum(entry.mask_path is not None for entry in document.frames)
    if masked:
        notify(Warned(stage="capture", message=f"mask_path of {masked} frames is not used"))
    root = path.parent
    return Source(
        path=path,
        views=_views(path, document),
        depth_units_per_metre=1.0 / document.depth_unit_scale_factor,
        depth_kind=document.depth_kind,
        id_names=_id_names(root / "labels.json"),
        points=None if document.ply_file_path is None else read_points(root / document.ply_file_path),
    )


def _views(path: Path, document: _Transforms) -> tuple[View, ...]:
    poses = _poses(path, document)
    views, bad = [], []
    for number, (entry, pose) in enumerate(zip(document.frames, poses, strict=True)):
        image = _image_path(path.parent, entry.file_path)
        try:
            lens = lens_of(document, entry, image if is_file(image) else None)
        except LensError as error:
            bad.append((f"frames[{number}], {entry.file_path}", str(error)))
            continue
        views.append(
            View(
                name=entry.file_path.removeprefix("./"),
                lens=lens,
                world_from_cam=pose,
                image=image,
                depth=None if entry.depth_file_path is None else path.parent / entry.depth_file_path,
                ids=_ids_path(path.parent, entry),
                normals=None if entry.normal_file_path is None else path.parent / entry.normal_file_path,
            )
        )
    if bad:
        where, problem = bad[0]
        counted = count_of(bad, len(document.frames))
        raise CaptureError(f"{path}: intrinsics of {counted} frames are not usable (first: {shown(where)}): {problem}")
    return tuple(views)


def _poses(path: Path, document: _Transforms) -> list[np.ndarray]:
    poses, bad = [], []
    for number, entry in enumerate(document.frames):
        try:
            poses.append(rigid(entry.transform_matrix) @ OPENCV_FROM_OPENGL)
        except PoseError as error:
            bad.append(f"frames[{number}], {entry.file_path}: {error}")
    if bad:
        raise complain(path, bad, len(document.frames), "poses are not usable", "Remove these frames or correct them.")
    return poses


def _image_path(root: Path, file_path: str) -> Path:
    """The file that is meant; old files leave the suffix away."""
    stated = root / file_path
    candidates = [stated, *(stated.with_name(stated.name + suffix) for suffix in _SUFFIXES if stated.name)]
    return next((candidate for candidate in candidates if is_file(candidate)), stated)


def _ids_path(root: Path, entry: _Entry) -> Path | None:
    """The id image that the frame names, or the one of the same stem in a sibling folder."""
    if entry.instance_file_path is not None:
        return root / entry.instance_file_path
    stated = Path(entry.file_path)
    inner = Path(*stated.parts[1:]) if len(stated.parts) > 1 and not stated.is_absolute() else Path(stated.name)
    for folder in _ID_FOLDERS:
        candidate = (root / folder / inner).with_suffix(".png")
        if inner.name and is_file(candidate):
            return candidate
    return None


def _id_names(path: Path) -> dict[int, str]:
    return parse_id_names(path, read_json(path, dict[str, str])) if is_file(path) else {}


READER = Reader(name="nerfstudio", expects="transforms.json (nerfstudio)", detect=detect, read=read)
