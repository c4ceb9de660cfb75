"""Reader of nerfstudio's transforms.json, and of its ancestors: instant-ngp's, and Blender's transforms_train.json.

Camera axes in the file are OpenGL's; https://docs.nerf.studio/quickstart/data_conventions.html describes the format.
"""

import math
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from goc.capture.config import CaptureConfig
from goc.capture.intrinsics import Intrinsics, LensError, lens_of
from goc.capture.pixels import numbers_in
from goc.capture.poses import OPENCV_FROM_OPENGL, PoseError, rigid
from goc.capture.readers.beside import ids_beside, image_named, names_beside, seed_points
from goc.capture.readers.reader import Reader
from goc.capture.source import Source, StoredDepthKind, View, complain, count_of, shown
from goc.errors import CaptureError
from goc.events import Listener, Warned
from goc.files import is_file, is_folder, read_json

_MILLIMETRE = 0.001
_FRACTIONS = (".npy", ".npz", ".exr", ".pfm")
_FAR_M = 50.0
"""Fractions whose median is beyond are no metres of a room."""
_HARMLESS = {
    *("sharpness", "colmap_im_id", "timestamp", "time", "aabb", "aabb_scale", "scale", "offset", "up", "render_aabb"),
    *("frames", "train_filenames", "val_filenames", "test_filenames", "orientation_override", "applied_transform"),
    *("applied_scale", "n_extra_learnable_dims", "exposure", "blur_score", "rotation", "white_transparent", "mask"),
    *("black_transparent", "fix_premult", "rolling_shutter", "motion_blur", "is_video", "cam_id", "fps", "name"),
    *("id", "index", "comment", "light_dirs"),
}
"""Keys of nerfstudio, instant-ngp and converters that change nothing of what is read."""


class _Entry(Intrinsics, kw_only=True):
    file_path: str
    transform_matrix: list[list[float]]
    depth_file_path: str | None = None
    depth_path: str | None = None
    """instant-ngp's name."""
    normal_file_path: str | None = None
    instance_file_path: str | None = None
    mask_path: str | None = None
    mask_file_path: str | None = None


class _Transforms(Intrinsics, kw_only=True):
    frames: list[_Entry]
    depth_unit_scale_factor: float | None = None
    integer_depth_scale: float | None = None
    """instant-ngp's name."""
    enable_depth_loading: bool = True
    depth_kind: StoredDepthKind = "metric"
    ply_file_path: str | None = None


def detect(path: Path) -> bool:
    """Whether `path` is a JSON file, or a folder with transforms.json, or with transforms_train.json."""
    return (is_file(path) and path.suffix == ".json") or _listing(path) is not None


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a transforms.json (or that of a folder) and what lies beside it: labels.json, seed points, a folder of ids.

    Raises:
        FileError: the JSON, labels.json or the point file is malformed.
        CaptureError: a pose is not rigid, or a camera model is unknown or lacks numbers.
    """
    path = path if is_file(path) else _listing(path) or path / "transforms.json"
    document = read_json(path, _Transforms)
    _report_unknown(path, notify)
    _report_splits(path, notify)
    root = path.parent
    views = _views(path, document)
    return Source(
        path=path,
        views=views,
        depth_units_per_metre=1.0 / _depth_unit(path, document, views, config),
        depth_kind=document.depth_kind,
        id_names=names_beside(root),
        points=None if document.ply_file_path is None else seed_points(root / document.ply_file_path),
        axes="opengl",
    )


def _listing(folder: Path) -> Path | None:
    if not is_folder(folder):
        return None
    names = ("transforms.json", "transforms_train.json")
    return next((folder / name for name in names if is_file(folder / name)), None)


def _report_splits(path: Path, notify: Listener) -> None:
    """Blender's folders have three lists."""
    if path.name == "transforms_train.json":
        others = [name for name in ("transforms_val.json", "transforms_test.json") if is_file(path.parent / name)]
        if others:
            message = f"{path.name} is read; the views of {' and '.join(others)} are not used"
            notify(Warned(stage="capture", message=message))


def _report_unknown(path: Path, notify: Listener) -> None:
    """Keys that goc does not know may change the meaning of those that it knows."""
    raw = read_json(path, dict[str, Any])
    frames = [frame for frame in raw.get("frames", []) if isinstance(frame, dict)]
    known = _HARMLESS | {name for struct in (_Transforms, _Entry) for name in struct.__struct_fields__}
    unknown = {key: "" for key in raw if key not in known}
    unknown |= {key: "frames: " for frame in frames for key in frame if key not in known}
    if unknown:
        names = ", ".join(where + shown(key) for key, where in list(unknown.items())[:6])
        more = f" and {len(unknown) - 6} more" if len(unknown) > 6 else ""
        notify(Warned(stage="capture", message=f"{path.name}: keys that are not understood: {names}{more}"))


def _depth_unit(path: Path, document: _Transforms, views: tuple[View, ...], config: CaptureConfig) -> float:
    """Scene units of one depth step: as stated; else millimetres, or for fractions what their size tells."""
    for name in ("depth_unit_scale_factor", "integer_depth_scale"):
        stated = getattr(document, name)
        if stated is not None:
            if not 0 < stated < math.inf:
                raise CaptureError(f"{path}: {name} is {stated:g}. Give the metres of one depth step, such as 0.001.")
            return stated
    first = next((view.depth for view in views if isinstance(view.depth, Path) and is_file(view.depth)), None)
    if first is None or not config.use_depth or first.suffix.lower() not in (*_FRACTIONS, ".tif", ".tiff"):
        return _MILLIMETRE
    stored = numbers_in(first)
    if stored.dtype.kind != "f":
        return _MILLIMETRE
    known = stored[np.isfinite(stored) & (stored > 0)]
    return 1.0 if not known.size or np.median(known) < _FAR_M else _MILLIMETRE


def _views(path: Path, document: _Transforms) -> tuple[View, ...]:
    poses = _poses(path, document)
    views, bad = [], []
    for number, (entry, pose) in enumerate(zip(document.frames, poses, strict=True)):
        image = image_named(path.parent, entry.file_path)
        try:
            lens = lens_of(document, entry, image if is_file(image) else None)
        except LensError as error:
            bad.append((f"frames[{number}], {entry.file_path}", str(error)))
            continue
        depth = entry.depth_file_path or entry.depth_path if document.enable_depth_loading else None
        views.append(
            View(
                name=entry.file_path.removeprefix("./"),
                lens=lens,
                world_from_cam=pose,
                image=image,
                depth=_file(path.parent, depth),
                ids=_ids_path(path.parent, entry),
                normals=_file(path.parent, entry.normal_file_path),
                mask=_file(path.parent, entry.mask_path or entry.mask_file_path),
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
            poses.append(rigid(_whole(entry.transform_matrix)) @ OPENCV_FROM_OPENGL)
        except PoseError as error:
            bad.append(f"frames[{number}], {entry.file_path}: {error}")
    if bad:
        raise complain(path, bad, len(document.frames), "poses are not usable", "Remove these frames or correct them.")
    return poses


def _whole(rows: list[list[float]]) -> list[list[float]]:
    """A matrix whose last number is 1: some programs for instant-ngp write homogeneous matrices of any scale."""
    if len(rows) == 4 and len(rows[3]) == 4 and rows[3][:3] == [0, 0, 0] and 0 < rows[3][3] < math.inf:
        return [[value / rows[3][3] for value in row] for row in rows]
    return rows


def _file(root: Path, name: str | None) -> Path | None:
    """The file of a frame; Windows' backslashes are taken for slashes where no file is named so."""
    if name is None:
        return None
    return root / name if is_file(root / name) else root / Path(PurePosixPath(name.replace("\\", "/")))


def _ids_path(root: Path, entry: _Entry) -> Path | None:
    """The id image that the frame names, or the one of the same stem in a sibling folder."""
    if entry.instance_file_path is not None:
        return _file(root, entry.instance_file_path)
    stated = Path(entry.file_path)
    inner = Path(*stated.parts[1:]) if len(stated.parts) > 1 and not stated.is_absolute() else Path(stated.name)
    return ids_beside(root, inner)


READER = Reader(name="nerfstudio", expects="transforms.json (nerfstudio)", detect=detect, read=read)
