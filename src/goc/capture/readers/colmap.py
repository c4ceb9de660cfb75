"""Reader of COLMAP's models: sparse/ (or sparse/0, or the model's own folder) beside images/.

images/…                          and, for those who have them, instance/… (ids) and masks/NAME.png (0 = ignore)
sparse/0/{cameras,images,points3D}.{bin,txt}
stereo/depth_maps/NAME.geometric.bin   dense depth of undistorted images, in the units of the model
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from goc.capture.config import CaptureConfig
from goc.capture.poses import PoseError, rigid
from goc.capture.readers.beside import ids_beside, image_named, names_beside
from goc.capture.readers.colmap_model import (
    ModelImage,
    count_images,
    model_file,
    read_cameras,
    read_images,
    read_model_points,
)
from goc.capture.readers.reader import Reader
from goc.capture.source import Lens, Source, View, complain
from goc.errors import CaptureError, FileError
from goc.events import Listener, Warned
from goc.files import is_file, is_folder, read_bytes

_IMAGES = ("images", "rgb", "input", "image", "images_2", "images_4", "images_8", ".")
_LIMIT = 1 << 30
_LONGEST_HEADER = 64


def detect(path: Path) -> bool:
    """Whether a model lies in `path`, in its sparse/, or in a folder there."""
    return bool(_models(path))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read the largest model.

    Raises:
        FileError: a file of the model is malformed.
        CaptureError: an unknown camera model, or images whose camera or pose makes no sense.
    """
    model = _largest(path, notify)
    root = _root(path, model)
    images = read_images(_needed(model, "images"))
    if not images:
        raise CaptureError(f"{model}: no image is registered. Run COLMAP's mapper again.")
    lenses = read_cameras(_needed(model, "cameras"))
    views = _views(model, root, _image_folder(root, images), images, lenses)
    points = model_file(model, "points3D")
    return Source(
        path=model,
        views=views,
        depth_units_per_metre=1.0,
        id_names=names_beside(root),
        points=None if points is None else read_model_points(points),
        metric=False,
        direction="world-to-camera",
    )


def _models(path: Path) -> list[Path]:
    """Folders that hold cameras and images."""
    if not is_folder(path):
        return []
    around = [path, path / "sparse", path / "colmap" / "sparse"]
    inner = [sorted(parent.iterdir()) for parent in around[1:] if is_folder(parent)]
    candidates = [*around, *(folder for folders in inner for folder in folders)]
    return [folder for folder in candidates if model_file(folder, "cameras") and model_file(folder, "images")]


def _largest(path: Path, notify: Listener) -> Path:
    models = _models(path)
    if len(models) == 1:
        return models[0]
    counts = {model: count_images(_needed(model, "images")) for model in models}
    chosen = max(models, key=lambda model: counts[model])
    others = ", ".join(f"{model.relative_to(path)}: {counts[model]}" for model in models if model != chosen)
    message = f"{len(models)} models: {chosen.relative_to(path)} is read, which has {counts[chosen]} images ({others})"
    notify(Warned(stage="capture", message=message))
    return chosen


def _needed(model: Path, stem: str) -> Path:
    file = model_file(model, stem)
    assert file is not None  # _models saw it
    return file


def _root(path: Path, model: Path) -> Path:
    """The folder beside whose images/ the model lies: the one that was given, or one above a model that was given."""
    if path != model:
        return path
    above = [model, *list(model.parents)[:3]]
    return next((folder for folder in above if is_folder(folder / "images")), path)


def _image_folder(root: Path, images: Sequence[ModelImage]) -> Path:
    """Where most of the first images are."""
    first = images[:20]
    counts = {name: sum(is_file(root / name / image.name) for image in first) for name in _IMAGES}
    best = max(_IMAGES, key=lambda name: counts[name])
    return root / (best if counts[best] else "images")


def _views(
    model: Path, root: Path, folder: Path, images: Sequence[ModelImage], lenses: dict[int, Lens]
) -> tuple[View, ...]:
    views, bad, alien = [], [], []
    for image in images:
        if image.camera not in lenses:
            alien.append(f"{image.name}, camera {image.camera}")
            continue
        try:
            pose = np.linalg.inv(rigid(image.cam_from_world()))
        except PoseError as error:
            bad.append(f"{image.name}: {error}")
            continue
        file = image_named(folder, image.name)
        inner = file.relative_to(folder)
        views.append(
            View(
                name=f"{folder.name}/{inner.as_posix()}" if folder != root else inner.as_posix(),
                lens=lenses[image.camera],
                world_from_cam=pose,
                image=file,
                depth=_depth(root, image.name),
                ids=ids_beside(root, inner),
                mask=_mask(root, image.name),
            )
        )
    if alien:
        raise complain(model, alien, len(images), "images are of a camera that is not there", "Copy the model again.")
    if bad:
        raise complain(model, bad, len(images), "poses are not usable", "Remove these images or correct them.")
    return tuple(views)


def _mask(root: Path, name: str) -> Path | None:
    return next((file for file in (root / "masks" / f"{name}.png", root / "masks" / name) if is_file(file)), None)


def _depth(root: Path, name: str) -> "ColmapNumbers | None":
    files = [root / "stereo" / "depth_maps" / f"{name}.{kind}.bin" for kind in ("geometric", "photometric")]
    return next((ColmapNumbers(file) for file in files if is_file(file)), None)


@dataclass(frozen=True)
class ColmapNumbers:
    """COLMAP's dense arrays: ASCII width&height&channels&, then float32 by rows."""

    path: Path

    def size(self) -> tuple[int, int]:
        """Width and height; raises FileError."""
        try:
            with self.path.open("rb") as file:
                width, height, _, _ = self._header(file.read(_LONGEST_HEADER))
        except OSError:
            read_bytes(self.path, _LIMIT)  # says what is wrong
            raise
        return width, height

    def read(self) -> Float32[np.ndarray, "h w"]:
        """Read them; raises FileError."""
        data = read_bytes(self.path, _LIMIT)
        width, height, channels, start = self._header(data[:_LONGEST_HEADER])
        if channels != 1 or len(data) - start < 4 * width * height:
            raise FileError(f"{self.path}: not one number for each of {width} x {height} pixels. Copy it again.")
        return np.frombuffer(data, "<f4", width * height, start).reshape(height, width)

    def _header(self, data: bytes) -> tuple[int, int, int, int]:
        words = data.split(b"&", 3)
        if len(words) != 4 or not all(word.isdigit() and len(word) < 7 for word in words[:3]):
            raise FileError(f"{self.path}: does not start with width&height&channels&. Copy it again.")
        width, height, channels = (int(word) for word in words[:3])
        return width, height, channels, len(data) - len(words[3])


READER = Reader(
    name="COLMAP", expects="sparse/ with cameras, images, points3D in .bin or .txt (COLMAP)", detect=detect, read=read
)
