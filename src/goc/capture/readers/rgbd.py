"""Reader of RGB-D folders: color/, depth/, pose/ and intrinsics, files of a view sharing their stem.

color/0000.jpg       or .png
depth/0000.png       16 bits along the optical axis, 0 = none; may be absent
pose/0000.txt        camera to world, OpenCV axes, 4 x 4
meta.json            width height fx fy cx cy depth_scale instances …   or intrinsics.txt, 3 x 3 or 4 x 4
instance/0000.png    ids; also instance_mask/, object_mask/ or mask/
"""

import math
from pathlib import Path

import msgspec
import numpy as np

from goc.capture.config import CaptureConfig
from goc.capture.poses import PoseError, rigid
from goc.capture.readers.reader import Reader
from goc.capture.source import IdCodes, Lens, Source, View, complain, count_of, parse_id_names, shown
from goc.errors import CaptureError, FileError
from goc.events import Listener, Warned
from goc.files import image_size, is_file, is_folder, read_json, read_matrix

_ID_FOLDERS = ("instance", "instance_mask", "object_mask", "mask")
_COLOUR = (".jpg", ".jpeg", ".png")
_CENTRE = 0.5  # calibrations of RGB-D cameras put the first pixel's centre at 0, this project at 0.5


class _Meta(msgspec.Struct, kw_only=True):
    fx: float
    fy: float
    cx: float
    cy: float
    width: int | None = None
    height: int | None = None
    depth_scale: float = 1000.0
    camera_convention: str = "OpenCV"
    instances: dict[str, str] = {}
    instance_background: int = 0
    instance_unknown: int | None = None
    mask_values: list[int] = []


def detect(path: Path) -> bool:
    """Whether `path` is a folder with color/ and pose/."""
    return is_folder(path / "color") and is_folder(path / "pose")


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read an RGB-D folder.

    Raises:
        FileError: meta.json, intrinsics.txt or a pose is malformed.
        CaptureError: views lack a pose, a pose is not rigid, or the intrinsics make no sense.
    """
    images = sorted(file for file in (path / "color").iterdir() if file.suffix.lower() in _COLOUR)
    if not images:
        raise CaptureError(
            f"{path / 'color'}: holds no {', '.join(_COLOUR)} images. Check that the capture is complete."
        )
    images = _with_poses(path, images, config, notify)
    _report_orphans(path, images, notify)
    images = _tracked(path, images, notify)
    where, meta = _meta(path, images[0])
    has_depth = is_folder(path / "depth")
    ids = next((path / folder for folder in _ID_FOLDERS if is_folder(path / folder)), None)
    lens = _lens(where, meta)
    poses = _poses(path, images)
    return Source(
        path=path,
        views=tuple(
            View(
                name=f"color/{image.name}",
                lens=lens,
                world_from_cam=pose,
                image=image,
                depth=path / "depth" / f"{image.stem}.png" if has_depth else None,
                ids=ids / f"{image.stem}.png" if ids else None,
            )
            for image, pose in zip(images, poses, strict=True)
        ),
        depth_units_per_metre=meta.depth_scale,
        id_codes=IdCodes(meta.instance_background, meta.instance_unknown, tuple(meta.mask_values)),
        id_names=parse_id_names(where, meta.instances),
    )


def _with_poses(path: Path, images: list[Path], config: CaptureConfig, notify: Listener) -> list[Path]:
    lacking = [image.name for image in images if not is_file(_pose_path(path, image))]
    if lacking and (not config.allow_missing or len(lacking) == len(images)):
        remedy = "Add pose/NAME.txt, or pass --capture.allow-missing to leave these views out."
        raise complain(path, lacking, len(images), "color images have no pose", remedy)
    if lacking:
        counted = count_of(lacking, len(images))
        message = f"{counted} color images have no pose and are left out (first: {lacking[0]})"
        notify(Warned(stage="capture", message=message))
    return [image for image in images if image.name not in lacking]


def _tracked(path: Path, images: list[Path], notify: Listener) -> list[Path]:
    """The images whose pose is known: where tracking was lost, ScanNet and others write nothing but -inf or nan."""
    lost = [image.name for image in images if _is_lost(_pose_path(path, image))]
    if lost and len(lost) < len(images):
        message = f"{count_of(lost, len(images))} views have no finite pose and are left out (first: {shown(lost[0])})"
        notify(Warned(stage="capture", message=message))
        return [image for image in images if image.name not in set(lost)]
    return images


def _is_lost(pose: Path) -> bool:
    try:
        return not np.isfinite(read_matrix(pose, finite=False)[:3]).any()
    except FileError:
        return False  # told with all others that are not usable


def _report_orphans(path: Path, images: list[Path], notify: Listener) -> None:
    """Poses without an image hint at images that got lost."""
    stems = {image.stem for image in images}
    orphans = sorted(file.name for file in (path / "pose").glob("*.txt") if file.stem not in stems)
    if orphans:
        message = f"{len(orphans)} poses have no color image and are not used (first: {orphans[0]})"
        notify(Warned(stage="capture", message=message))


def _pose_path(path: Path, image: Path) -> Path:
    return path / "pose" / f"{image.stem}.txt"


def _poses(path: Path, images: list[Path]) -> list[np.ndarray]:
    poses, bad = [], []
    for image in images:
        file = _pose_path(path, image)
        try:
            poses.append(rigid(read_matrix(file)))
        except PoseError as error:
            bad.append(f"{file.name}: {error}")
        except FileError as error:
            bad.append(str(error).removeprefix(f"{path}/").removesuffix("."))
    if bad:
        raise complain(path / "pose", bad, len(images), "poses are not usable", "Remove these views or correct them.")
    return poses


def _meta(path: Path, image: Path) -> tuple[Path, _Meta]:
    """The file that gives the intrinsics, and what it says."""
    if is_file(path / "meta.json"):
        return path / "meta.json", _with_size(read_json(path / "meta.json", _Meta), image)
    where = path / "intrinsics.txt"
    if not is_file(where):
        raise CaptureError(
            f"{path}: no intrinsics. Add meta.json (width height fx fy cx cy) or intrinsics.txt (3 x 3)."
        )
    matrix = read_matrix(where)
    if matrix.shape not in ((3, 3), (4, 4)):
        raise CaptureError(f"{where}: expected 3 x 3 or 4 x 4 numbers, found {' x '.join(map(str, matrix.shape))}.")
    if matrix[0, 1] or matrix[1, 0] or matrix[2, 0] or matrix[2, 1] or matrix[2, 2] != 1:
        raise CaptureError(f"{where}: not of the form fx 0 cx / 0 fy cy / 0 0 1. Skewed pixels are not supported.")
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return where, _with_size(_Meta(fx=fx, fy=fy, cx=cx, cy=cy), image)


def _with_size(meta: _Meta, image: Path) -> _Meta:
    """Fill in the size from the first image's header where it is not stated.

    Where that image lies on its side, as the principal point tells, the intrinsics are of the others.
    """
    if meta.width is not None and meta.height is not None:
        return meta
    sizes = image_size(image), image_size(image)[::-1]
    width, height = min(sizes, key=lambda size: math.hypot(meta.cx - size[0] / 2, meta.cy - size[1] / 2))
    return msgspec.structs.replace(meta, width=width, height=height)


def _lens(where: Path, meta: _Meta) -> Lens:
    if not meta.camera_convention.startswith("OpenCV"):
        named = meta.camera_convention[:40]
        raise CaptureError(
            f"{where}: camera_convention is {named!r}. Write poses with OpenCV axes (x right, y down, z forward)."
        )
    if not 0 < meta.depth_scale < math.inf:
        raise CaptureError(
            f"{where}: depth_scale is {meta.depth_scale:g}. Give the depth steps in one metre, such as 1000."
        )
    width, height = meta.width or 0, meta.height or 0
    if not (width > 0 and height > 0 and meta.fx > 0 and meta.fy > 0 and math.isfinite(meta.fx * meta.fy)):
        stated = f"width {width}, height {height}, fx {meta.fx:g}, fy {meta.fy:g}"
        raise CaptureError(f"{where}: {stated}. All four must be positive.")
    if not (0 <= meta.cx <= width and 0 <= meta.cy <= height):
        stated = f"{meta.cx:g}, {meta.cy:g} is outside the image of {width} x {height}"
        raise CaptureError(f"{where}: the principal point {stated}. Give cx, cy in pixels.")
    return Lens(width, height, (meta.fx, meta.fy), (meta.cx + _CENTRE, meta.cy + _CENTRE))


READER = Reader(
    name="RGB-D", expects="color/ and pose/ with meta.json or intrinsics.txt (RGB-D)", detect=detect, read=read
)
