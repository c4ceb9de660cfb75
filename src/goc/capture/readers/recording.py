"""What recordings of cameras have in common: numbered files, poses that were lost, more frames than are needed."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from goc.capture.config import CaptureConfig
from goc.capture.poses import PoseError, rigid
from goc.capture.source import View, complain, count_of, shown
from goc.errors import CaptureError, FileError
from goc.events import Listener, Warned
from goc.files import is_file, is_folder

COLOUR = (".jpg", ".jpeg", ".png")
"""Suffixes of photographs, lower case."""
CENTRE = 0.5
"""Calibrations of OpenCV, ROS and RGB-D cameras put the first pixel's centre at 0, this project at 0.5."""
_ENOUGH_VIEWS = 400
_STAGE = "capture"
_Item = TypeVar("_Item")


def numbered(folder: Path, suffixes: Sequence[str], stem: str = r"\D*(\d+)") -> dict[int, Path]:
    """Files of a folder by the number in their names, in its order; `10.png` comes after `9.png`.

    Args:
        folder: may be absent, which gives nothing.
        suffixes: lower case, with their dots.
        stem: what a name is without its suffix; its group is the number.
    """
    if not is_folder(folder):
        return {}
    found = {}
    for file in folder.iterdir():
        number = re.fullmatch(stem, file.stem)
        if number and file.suffix.lower() in suffixes and not file.name.startswith("."):
            found[int(number[1])] = file
    return dict(sorted(found.items()))


def demand(path: Path, kind: str, needed: Iterable[tuple[str, bool]]) -> None:
    """Refuse a folder of a known format that is not complete.

    Args:
        path: the folder.
        kind: name of the format, as its users call it.
        needed: what has to be there, and whether it is.

    Raises:
        CaptureError: something is missing.
    """
    missing = [name for name, there in needed if not there]
    if missing:
        raise CaptureError(f"{path}: a {kind} capture without {' and '.join(missing)}. Export or copy it again.")


def paired(
    path: Path, images: dict[int, Path], files: dict[int, _Item], what: str, config: CaptureConfig, notify: Listener
) -> list[int]:
    """Numbers of the images that have such a file; those that lack one are left out, or refused.

    Raises:
        CaptureError: images lack one, and the settings do not allow it, or all do.
    """
    lacking = [images[number].name for number in images if number not in files]
    if lacking and (not config.allow_missing or len(lacking) == len(images)):
        remedy = "Copy the capture again, or pass --capture.allow-missing to leave these views out."
        raise complain(path, lacking, len(images), f"images have no {what}", remedy)
    if lacking:
        counted = count_of(lacking, len(images))
        warn(notify, f"{counted} images have no {what} and are left out (first: {shown(lacking[0])})")
    return [number for number in images if number in files]


def step_of(count: int, config: CaptureConfig, notify: Listener) -> int:
    """N where every n-th of `count` frames of a recording is used: as the settings say, or so that at most 400 are."""
    step = config.every or -(-count // _ENOUGH_VIEWS)
    if step > 1 and config.every is None:
        used = -(-count // step)
        warn(notify, f"{used} of {count:,} frames are used, one in {step}. --capture.every says otherwise")
    return max(step, 1)


def thinned(items: Sequence[_Item], config: CaptureConfig, notify: Listener) -> list[_Item]:
    """The frames of a recording that are used (see `step_of`)."""
    return list(items[:: step_of(len(items), config, notify)])


def posed(where: Path, views: Sequence[View], notify: Listener) -> tuple[View, ...]:
    """Views with exactly rigid poses; those whose tracking was lost (numbers that are not finite) are left out.

    Raises:
        CaptureError: a pose is finite and not rigid, or all were lost.
    """
    kept, lost, bad = [], [], []
    for view in views:
        if not np.isfinite(view.world_from_cam).all():
            lost.append(view.name)
            continue
        try:
            kept.append(replace(view, world_from_cam=rigid(view.world_from_cam)))
        except PoseError as error:
            bad.append(f"{view.name}: {error}")
    if bad:
        raise complain(where, bad, len(views), "poses are not usable", "Remove these views or correct them.")
    if lost and not kept:
        raise complain(where, lost, len(views), "poses are not finite", "The tracking was lost: record it again.")
    if lost:
        counted = count_of(lost, len(views))
        warn(notify, f"{counted} poses were lost (not finite), and their views are left out (first: {shown(lost[0])})")
    return tuple(kept)


def read_all(where: Path, files: Sequence[Path], read: Callable[[Path], _Item], what: str) -> list[_Item]:
    """What `read` makes of each of many small files; those that are damaged are counted, and told in one error.

    Raises:
        CaptureError: one or more are not readable.
    """
    made, bad = [], []
    for file in files:
        try:
            made.append(read(file))
        except FileError as error:
            bad.append(str(error).removeprefix(f"{where}/").removesuffix("."))
    if bad:
        raise complain(where, bad, len(files), f"{what} are not usable", "Remove these views or correct them.")
    return made


def first_with(path: Path, names: Sequence[str]) -> Path | None:
    """The first of some files that is in a folder or in the one above."""
    candidates = [folder / name for folder in (path, path.resolve().parent) for name in names]
    return next((file for file in candidates if is_file(file)), None)


def warn(notify: Listener, message: str) -> None:
    """Tell of something that did not stop the reader."""
    notify(Warned(stage=_STAGE, message=message))
