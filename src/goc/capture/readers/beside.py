"""Files that lie beside a capture's images, by name: ids, labels, images without their suffix."""

from pathlib import Path, PurePosixPath

import numpy as np

from goc.capture.source import FarPoints, parse_id_names
from goc.files import is_file, read_json, read_ply, read_points
from goc.scene import PointCloud

ID_FOLDERS = ("instance", "instance_mask", "object_mask")
_SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".heic", ".HEIC", ".webp", ".tif", ".tiff")
_ID_SUFFIXES = (".png", ".tif", ".tiff", ".npy")
_NO_PHOTOGRAPHS = {*ID_FOLDERS, "masks", "mask", "depth", "depths", "normals", "normal"}
_FAR = 1000.0
"""float32 keeps positions beyond to a tenth of a millimetre at best."""
_SCALED = ("images_2", "images_4", "images_8")


def image_named(root: Path, name: str) -> Path:
    """The image that a file names, in spellings that programs write: `stated` itself where none is there.

    Backslashes of Windows, no suffix, only in images_2 (4, 8), or beside the file although a folder is named.
    """
    inner = PurePosixPath(name.replace("\\", "/"))
    folders = [inner, *(PurePosixPath(folder, *inner.parts[1:]) for folder in _SCALED if len(inner.parts) > 1)]
    spelled = [*folders, PurePosixPath(inner.name)]
    for stated in (root / name, *(root / Path(item) for item in spelled)):
        for candidate in (stated, *(stated.with_name(stated.name + suffix) for suffix in _SUFFIXES if stated.name)):
            if is_file(candidate):
                return candidate
    return root / Path(inner)


def photographs(root: Path) -> dict[str, Path]:
    """Images below a folder (three levels) by name, and by name without suffix; folders for ids and masks are not."""
    found: dict[str, Path] = {}
    patterns = ("images/**/*", "*", "*/*", "*/*/*")
    for file in (file for pattern in patterns for file in sorted(root.glob(pattern))):
        first = file.relative_to(root).parts[0]
        if file.suffix in _SUFFIXES and first not in _NO_PHOTOGRAPHS and is_file(file):
            found.setdefault(file.name, file)
            found.setdefault(file.stem, file)
    return found


def ids_beside(root: Path, inner: Path) -> Path | None:
    """The id image of the same name, but for the suffix, in a folder for ids; or with the image's suffix kept."""
    for folder in ID_FOLDERS:
        for suffix in _ID_SUFFIXES:
            for name in (inner.with_suffix(suffix), inner.with_name(inner.name + suffix)) if inner.name else ():
                if is_file(root / folder / name):
                    return root / folder / name
    return None


def seed_points(path: Path) -> PointCloud | FarPoints:
    """Points of a PLY file, in double precision where they are far from the origin; raises FileError."""
    points = read_points(path)
    if np.abs(points.positions).max() < _FAR:
        return points
    vertex = read_ply(path)["vertex"]
    positions = np.stack([np.asarray(vertex[axis], np.float64) for axis in "xyz"], 1)
    return FarPoints(positions=positions, colours=points.colours)


def names_beside(root: Path) -> dict[int, str]:
    """Names of ids in labels.json; none where it is absent."""
    path = root / "labels.json"
    return parse_id_names(path, read_json(path, dict[str, str])) if is_file(path) else {}
