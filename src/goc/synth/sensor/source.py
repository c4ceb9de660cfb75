"""Reads the parts of a nerfstudio capture that faults work on; the rest of its files is copied unchanged."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import torch

from goc.errors import CaptureError
from goc.files import is_file, is_folder, read_json
from goc.files.reading import unreadable
from goc.scene import Camera

_MAIN = "transforms.json"
_LENS = ("fl_x", "fl_y", "cx", "cy", "w", "h")


class FrameEntry(msgspec.Struct, kw_only=True):
    """One frame of a transforms.json."""

    file_path: str
    transform_matrix: list[list[float]]
    depth_file_path: str | None = None
    instance_file_path: str | None = None
    fl_x: float | None = None
    fl_y: float | None = None
    cx: float | None = None
    cy: float | None = None
    w: float | None = None
    h: float | None = None


class _Transforms(msgspec.Struct, kw_only=True):
    frames: list[FrameEntry]
    depth_unit_scale_factor: float = 0.001
    depth_kind: str = "metric"
    ply_file_path: str | None = None
    fl_x: float | None = None
    fl_y: float | None = None
    cx: float | None = None
    cy: float | None = None
    w: float | None = None
    h: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class SourceCapture:
    """A capture to degrade: its files, and its views by image path."""

    root: Path
    main: str
    """Name of the file that lists the views."""
    documents: dict[str, dict[str, Any]]
    """All transforms files of the folder as they are, by name."""
    frames: dict[str, FrameEntry]
    """All views by image path."""
    shared: _Transforms
    """Values of the main file that its frames share."""

    def camera(self, entry: FrameEntry, width: int, height: int) -> Camera:
        """Intrinsics of a view, at the size of its depth image; the pose is the identity.

        Raises:
            CaptureError: a number is missing.
        """
        given = {name: getattr(entry, name) or getattr(self.shared, name) for name in _LENS}
        missing = [name for name in _LENS if not given[name]]
        if missing:
            raise CaptureError(
                f"{self.root / self.main}: {entry.file_path} has no {', '.join(missing)}. Add them to the file."
            )
        camera = Camera(
            focal_px=torch.tensor([given["fl_x"], given["fl_y"]], dtype=torch.float32),
            centre_px=torch.tensor([given["cx"], given["cy"]], dtype=torch.float32),
            width=int(given["w"]),
            height=int(given["h"]),
            world_from_cam=torch.eye(4),
        )
        return camera.resized(width, height)


def read_source(path: Path) -> SourceCapture:
    """Read all transforms files of a folder, or the one that is named.

    Raises:
        CaptureError: no capture, without frames, or a path in it leads out of its folder.
        FileError: a file is malformed.
    """
    if is_file(path) and path.suffix == ".json":
        root, names = path.parent, [path.name]
    elif is_folder(path) and is_file(path / _MAIN):
        root = path
        names = sorted({_MAIN, *(item.name for item in path.glob("transforms_*.json"))}, key=lambda name: name != _MAIN)
    else:
        raise CaptureError(f"{path}: no capture here: {_MAIN} is missing. Give the folder of a nerfstudio capture.")
    parsed = {name: read_json(root / name, _Transforms) for name in names}
    frames: dict[str, FrameEntry] = {}
    for name, document in parsed.items():
        for entry in document.frames:
            _check_inside(root / name, entry)
            frames.setdefault(entry.file_path, entry)
    if not frames:
        raise CaptureError(f"{root / names[0]}: has no frames. Give a capture with views.")
    documents = {name: read_json(root / name, dict[str, Any]) for name in names}
    return SourceCapture(root=root, main=names[0], documents=documents, frames=frames, shared=parsed[names[0]])


def _check_inside(where: Path, entry: FrameEntry) -> None:
    """Paths are kept in the copy, so they must not lead out of it."""
    for path in (entry.file_path, entry.depth_file_path, entry.instance_file_path):
        if path is not None and (Path(path).is_absolute() or ".." in Path(path).parts):
            raise CaptureError(f"{where}: {path} lies outside the capture. Move the file into its folder.")


def link(source: Path, target: Path) -> None:
    """The same file under another name; a copy where the system cannot share it.

    Raises:
        FileError: it is missing, or the system refuses both.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source.resolve(), target)
    except OSError:
        try:
            shutil.copyfile(source, target)
        except OSError as error:
            raise unreadable(source, error) from error
