"""Archives and videos, unpacked once into a cache folder, from which their images are read as any others.

The folder is $XDG_CACHE_HOME/goc/captures/NAME-DIGEST (~/.cache where that is not set); the digest is of the archive's
path, size and time of change, so that a changed archive is unpacked anew. Whoever needs the space may delete it.
"""

import hashlib
import os
import secrets
import shutil
import stat
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath

from goc.capture.source import shown
from goc.errors import FileError
from goc.events import Listener, Warned
from goc.files import is_folder

_LAYOUT = 1  # of what is unpacked: a new number makes old folders unused
_MOST_FILES = 500_000
_MOST_GROWTH = 50  # unpacked bytes for a packed one; images and compressed depth hardly grow
_SPARE_BYTES = 64 << 20  # growth and room on the disk that are nobody's concern
_BLOCK = 1 << 20


def unpacked(
    archive: Path, fill: Callable[[Path], None], notify: Listener, *, kind: str = "", size: int | None = None
) -> Path:
    """Return the folder that holds what is in an archive; fill it where it is not there yet.

    Args:
        archive: file that is unpacked.
        fill: writes everything into the new folder that it is given; what it writes appears under the final name only
            when it ends well.
        notify: hears where the folder is and how large, when it is new.
        kind: tells apart what is made of one archive in different ways.
        size: bytes that unpacking takes, where they are known.

    Raises:
        FileError: the archive is missing, or the disk is full or refuses.
    """
    folder = _root() / f"{_plain(archive.stem)}-{_digest(archive, kind)}"
    if is_folder(folder):
        return folder
    temporary = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}")
    try:
        temporary.mkdir(parents=True)
        _check_space(temporary, archive, size or 0)
        fill(temporary)
        if not is_folder(folder):  # or another process was faster
            temporary.rename(folder)
    except OSError as error:
        remedy = "Free some disk space, or set XDG_CACHE_HOME to a folder elsewhere."
        raise FileError(f"{folder}: {archive.name} cannot be unpacked ({error.strerror}). {remedy}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    taken = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    message = f"{shown(archive.name)} is unpacked in {folder} ({taken / 1e6:.0f} MB), which may be deleted afterwards"
    notify(Warned(stage="capture", message=message))
    return folder


def extract_zip(archive: Path, wanted: Callable[[str], bool], target: Path) -> None:
    """Write the files of a ZIP archive whose names are wanted into a folder, a block at a time.

    Raises:
        FileError: not a ZIP archive, damaged, encrypted, or one that would write outside the folder (a name with `..`,
            an absolute one, a link) or grow without measure.
    """
    with _opened(archive) as packed:
        entries = [entry for entry in packed.infolist() if not entry.is_dir() and wanted(entry.filename)]
        _check_entries(archive, entries)
        for entry in entries:
            path = target.joinpath(*PurePosixPath(entry.filename).parts)
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("xb") as file:
                file.writelines(_blocks(archive, packed, entry))


def zip_names(archive: Path) -> list[str]:
    """Names of the files in a ZIP archive.

    Raises:
        FileError: missing or not a ZIP archive.
    """
    with _opened(archive) as packed:
        return [entry.filename for entry in packed.infolist() if not entry.is_dir()]


def read_zipped(archive: Path, name: str, limit: int) -> bytes:
    """One file of a ZIP archive.

    Raises:
        FileError: it is missing or damaged, or has more than `limit` bytes.
    """
    with _opened(archive) as packed:
        try:
            entry = packed.getinfo(name)
        except KeyError as error:
            raise FileError(f"{archive}: holds no {name}. Export it again.") from error
        if entry.file_size > limit:
            text = f"{archive}: {name} has {entry.file_size:,} bytes, more than the {limit:,} that are expected"
            raise FileError(f"{text}. Export it again.")
        return b"".join(_blocks(archive, packed, entry))


def _opened(archive: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(archive)
    except FileNotFoundError as error:
        raise FileError(f"{archive}: not found. Check the path.") from error
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError) as error:
        raise FileError(f"{archive}: not a readable ZIP archive ({error}). Copy or export it again.") from error


def _blocks(archive: Path, packed: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Iterator[bytes]:
    try:
        with packed.open(entry) as file:
            yield from iter(lambda: file.read(_BLOCK), b"")
    except Exception as error:  # damaged data raises what each decompressor has
        name = shown(entry.filename)
        raise FileError(f"{archive}: {name} is damaged or encrypted ({error}). Copy or export it again.") from error


def _check_entries(archive: Path, entries: list[zipfile.ZipInfo]) -> None:
    for entry in entries:
        parts = PurePosixPath(entry.filename).parts
        leaves = entry.filename.startswith("/") or ".." in parts or "\\" in entry.filename or ":" in entry.filename
        if leaves or "\0" in entry.filename or stat.S_ISLNK(entry.external_attr >> 16):
            name = shown(entry.filename)
            raise FileError(f"{archive}: {name} would be written outside the folder. Do not trust this archive.")
    if len({entry.filename for entry in entries}) < len(entries):
        raise FileError(f"{archive}: holds two files of one name. Export it again.")
    size, packed = sum(entry.file_size for entry in entries), archive.stat().st_size
    if len(entries) > _MOST_FILES or size > packed * _MOST_GROWTH + _SPARE_BYTES:
        text = f"{len(entries):,} files of {size:,} bytes in an archive of {packed:,}"
        raise FileError(f"{archive}: {text}, which no capture has. Do not trust this archive.")


def _root() -> Path:
    stated = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(stated) if stated.startswith("/") else Path.home() / ".cache") / "goc" / "captures"


def _digest(archive: Path, kind: str) -> str:
    try:
        status = archive.stat()
        words = (_LAYOUT, kind, archive.resolve(), status.st_size, status.st_mtime_ns)
    except OSError as error:
        raise FileError(f"{archive}: cannot be read ({error.strerror}). Check the path.") from error
    return hashlib.sha256("\n".join(map(str, words)).encode("utf-8", "surrogateescape")).hexdigest()[:16]


def _plain(stem: str) -> str:
    return "".join(letter if letter.isascii() and (letter.isalnum() or letter in "-_") else "_" for letter in stem[:40])


def _check_space(folder: Path, archive: Path, size: int) -> None:
    free = shutil.disk_usage(folder).free
    if size + _SPARE_BYTES > free:
        remedy = "Free some disk space, or set XDG_CACHE_HOME to a folder elsewhere."
        text = f"{archive} takes {size / 1e6:,.0f} MB unpacked, and {free / 1e6:,.0f} are free"
        raise FileError(f"{folder.parent}: {text}. {remedy}")
