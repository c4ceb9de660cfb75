"""Frames of a video, as photographs in a cache folder: videos cannot be read from the middle.

The folder is $XDG_CACHE_HOME/goc/captures/NAME-DIGEST (~/.cache where that is not set); the digest is of the video's
path, size and time of change, and of which frames are taken. Whoever needs the space may delete it.
"""

import hashlib
import os
import secrets
import shutil
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from goc.capture.source import shown
from goc.errors import FileError
from goc.events import Listener, Progress, Warned
from goc.files import is_folder

_LAYOUT = 1  # of the folder: a new number makes old ones unused
_QUALITY = 95
_SPARE_BYTES = 512 << 20
_REMEDY = "Install ffmpeg, or: pip install 'goc[video]'"


def video_frames(video: Path, step: int, notify: Listener) -> dict[int, Path]:
    """Every n-th frame of a video by its number, from 0; as stored, without the turn that its header may ask for.

    Args:
        video: any file that ffmpeg reads.
        step: n.
        notify: hears progress, and where the frames are, the first time.

    Raises:
        FileError: the video is missing or damaged, the disk is full, or nothing here can decode videos.
    """
    fill = partial(_decode, video, step, notify)
    folder = unpacked_once(video, str(step), fill, notify)
    return {int(file.stem): file for file in sorted(folder.glob("*.jpg"))}


def unpacked_once(packed: Path, key: str, fill: Callable[[Path], None], notify: Listener) -> Path:
    """The folder that holds what was taken out of a file; made where it is not there yet.

    Args:
        packed: the file.
        key: tells apart what is taken out of one file in different ways.
        fill: writes into the new folder it is given, which gets its name only when that ends well.
        notify: hears where the folder is and how large, the first time.

    Raises:
        FileError: the file is missing, the disk is full, or what `fill` raises.
    """
    folder = _root() / f"{_plain(packed.stem)}-{_digest(packed, key)}"
    if is_folder(folder):
        return folder
    temporary = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}")
    try:
        temporary.mkdir(parents=True)
        fill(temporary)
        if not any(temporary.iterdir()):
            raise FileError(f"{packed}: no frame can be decoded. Copy or export it again.")
        if not is_folder(folder):  # or another process was faster
            temporary.rename(folder)
    except OSError as error:
        remedy = "Free some disk space, or set XDG_CACHE_HOME to a folder elsewhere."
        raise FileError(f"{folder}: cannot be written ({error.strerror}). {remedy}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    taken = sum(file.stat().st_size for file in folder.iterdir())
    place = f"{folder} ({taken / 1e6:.0f} MB), which may be deleted afterwards"
    notify(Warned(stage="capture", message=f"frames of {shown(packed.name)} are in {place}"))
    return folder


def _decode(video: Path, step: int, notify: Listener, folder: Path) -> None:
    _decoder(video)(video, step, notify, folder)


def _decoder(video: Path) -> Callable[[Path, int, Listener, Path], None]:
    try:
        import cv2  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError:
        program = shutil.which("ffmpeg")
        if program is None:
            raise FileError(f"{video}: nothing here can decode videos. {_REMEDY}.") from None
        return partial(_by_program, program)
    return partial(_by_library, cv2)


def _by_library(cv2: Any, video: Path, step: int, notify: Listener, folder: Path) -> None:
    reader = cv2.VideoCapture(str(video))
    reader.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    total = max(int(reader.get(cv2.CAP_PROP_FRAME_COUNT)), 1)
    number = 0
    while reader.grab():
        if number % step == 0:
            _check_space(folder)
            decoded, pixels = reader.retrieve()
            if decoded:
                cv2.imwrite(str(folder / f"{number:06}.jpg"), pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
            notify(Progress(stage="capture", done=min(number + 1, total), total=total))
        number += 1
    reader.release()


def _by_program(program: str, video: Path, step: int, notify: Listener, folder: Path) -> None:
    _check_space(folder)
    frames = ["-vf", f"select=not(mod(n\\,{step}))", "-fps_mode", "passthrough", "-q:v", "2", "-start_number", "0"]
    command = [program, "-v", "error", "-nostdin", "-noautorotate", "-i", f"file:{video}", *frames, "%06d.jpg"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise FileError(f"{video}: ffmpeg cannot decode it ({shown(said)}). Copy or export it again.")
    # from the last: no name is taken yet
    for file in sorted(folder.glob("*.jpg"), reverse=True):
        file.rename(file.with_name(f"{int(file.stem) * step:06}.jpg"))
    notify(Progress(stage="capture", done=1, total=1))


def _root() -> Path:
    stated = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(stated) if stated.startswith("/") else Path.home() / ".cache") / "goc" / "captures"


def _digest(video: Path, key: str) -> str:
    try:
        status = video.stat()
        words = (_LAYOUT, key, video.resolve(), status.st_size, status.st_mtime_ns)
    except OSError as error:
        raise FileError(f"{video}: cannot be read ({error.strerror}). Check the path.") from error
    return hashlib.sha256("\n".join(map(str, words)).encode("utf-8", "surrogateescape")).hexdigest()[:16]


def _plain(stem: str) -> str:
    return "".join(letter if letter.isascii() and (letter.isalnum() or letter in "-_") else "_" for letter in stem[:40])


def _check_space(folder: Path) -> None:
    free = shutil.disk_usage(folder).free
    if free < _SPARE_BYTES:
        remedy = "Free some disk space, or set XDG_CACHE_HOME to a folder elsewhere."
        raise FileError(f"{folder.parent}: {free / 1e6:,.0f} MB are free, too few for the frames of a video. {remedy}")
