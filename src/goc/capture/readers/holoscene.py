"""Reader of HoloScene's captures: nerfstudio's transforms.json, and what networks guessed of its images.

images/…  instance_mask/…            8 bits: 255 is the room, v is object v + 1
PRIOR/depth/*.npy  PRIOR/normal/*    relative depth, normals in OpenCV camera axes; PRIOR is such as marigold_ft

The files of these folders belong together by their order, not by their names.
"""

from dataclasses import replace
from pathlib import Path

from goc.capture.config import CaptureConfig
from goc.capture.pixels import path_of
from goc.capture.readers import nerfstudio
from goc.capture.readers.reader import Reader
from goc.capture.source import IdCodes, Source
from goc.errors import CaptureError
from goc.events import Listener
from goc.files import is_file, is_folder, read_bytes
from goc.scene import ROOM

_LIMIT = 256 << 20
_ROOM_VALUE = 255


def detect(path: Path) -> bool:
    """Whether `path` has transforms.json that names no depth, instance_mask/, and a folder of depth/ and normal/."""
    if not (is_file(path / "transforms.json") and is_folder(path / "instance_mask") and _prior(path)):
        return False
    return b'"depth_file_path"' not in read_bytes(path / "transforms.json", _LIMIT)


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a capture.

    Raises:
        FileError: transforms.json is malformed.
        CaptureError: a pose is not rigid, or folders hold different numbers of files.
    """
    source = nerfstudio.READER.read(path, config, notify)
    prior = _prior(path) or path
    images = _files(path / "images")
    if not images:
        raise CaptureError(f"{path}: a HoloScene capture without images in images/. Copy it again.")
    kinds = {"ids": path / "instance_mask", "depth": prior / "depth", "normals": prior / "normal"}
    columns = {kind: _files(folder) for kind, folder in kinds.items()}
    for kind, files in columns.items():
        if len(files) != len(images):
            text = f"{kinds[kind]}: {len(files)} files for the {len(images)} of images/, which they follow by order"
            raise CaptureError(f"{text}. Copy the capture again.")
    order = {image.resolve(): number for number, image in enumerate(images)}
    views = []
    for view in source.views:
        number = order.get(path_of(view.image).resolve())
        if number is not None:
            view = replace(view, **{kind: files[number] for kind, files in columns.items()})
        views.append(view)
    table = ((_ROOM_VALUE, ROOM), *((value, value + 1) for value in range(_ROOM_VALUE)))
    codes = IdCodes(table=table)
    return replace(source, views=tuple(views), id_codes=codes, depth_kind="affine", depth_units_per_metre=1.0)


def _prior(path: Path) -> Path | None:
    """The folder of what networks guessed."""
    folders = [path, *sorted(folder for folder in path.iterdir() if is_folder(folder))]
    return next((folder for folder in folders if is_folder(folder / "depth") and is_folder(folder / "normal")), None)


def _files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if is_file(file)) if is_folder(folder) else []


READER = Reader(
    name="HoloScene", expects="transforms.json, instance_mask/ and PRIOR/depth (HoloScene)", detect=detect, read=read
)
