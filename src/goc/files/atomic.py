"""Writing so that a file is either the old one or the new one, whatever stops the program."""

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from goc.errors import FileError

_REMEDIES = {
    errno.ENOSPC: "Free some disk space, or write elsewhere.",
    errno.EDQUOT: "Free some of the disk quota, or write elsewhere.",
    errno.EACCES: "Choose a folder you may write to.",
    errno.EPERM: "Choose a folder you may write to.",
    errno.EROFS: "Choose a folder you may write to.",
    errno.EISDIR: "Remove the folder of that name, or choose another name.",
    errno.ENOTDIR: "A part of this path is a file: choose another folder.",
    errno.EEXIST: "A part of this path is a file: choose another folder.",
    errno.ENAMETOOLONG: "Choose a shorter path.",
}
_FOLDERS_WITHOUT_FSYNC = (errno.EINVAL, errno.ENOTSUP, errno.EACCES, errno.EBADF)


@contextmanager
def write_atomic(path: Path) -> Iterator[BinaryIO]:
    """Open a binary file that appears under `path` only when the block ends well.

    The bytes go to a temporary name in the same folder (made if need be), are synced, and renamed over `path`; then the
    folder is synced, so that the name survives a power cut. If the block raises, `path` is as it was before.

    Raises:
        FileError: the system refuses (disk full, permission, …).
    """
    temporary = path.with_name(f".{path.name[:100]}.{secrets.token_hex(6)}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise _refused(path, error) from error
    finally:
        _discard(temporary)


def write_bytes(path: Path, data: bytes | memoryview) -> None:
    """Write a whole file at once, atomically (see `write_atomic`)."""
    with write_atomic(path) as file:
        file.write(data)


def move_file(source: Path, target: Path) -> None:
    """Rename a file over `target` on the same file system, durably; folders are made if need be.

    Raises:
        FileError: the system refuses; `target` is as it was before.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        source.replace(target)
        _sync_folder(target.parent)
    except (OSError, ValueError) as error:
        raise _refused(target, error) from error


def _refused(path: Path, error: OSError | ValueError) -> FileError:
    code = error.errno if isinstance(error, OSError) else None
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return FileError(f"{path}: cannot be written ({reason}). {_REMEDIES.get(code, 'Check the path.')}")


def _discard(temporary: Path) -> None:
    """Remove what an interrupted write left; after a rename there is nothing."""
    try:
        temporary.unlink(missing_ok=True)
    except (OSError, ValueError):
        return  # the error that led here says more


def _sync_folder(folder: Path) -> None:
    """Make a rename durable; some file systems cannot sync a folder, and then need not."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _FOLDERS_WITHOUT_FSYNC:
            raise
    finally:
        os.close(descriptor)
