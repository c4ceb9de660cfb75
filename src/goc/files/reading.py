"""Reading bytes with one kind of error and an upper bound."""

from pathlib import Path

from goc.errors import FileError

_LONGEST_MESSAGE = 200


def read_bytes(path: Path, limit: int) -> bytes:
    """The whole file.

    Args:
        path: what to read.
        limit: most bytes to take; a larger file is refused before anything is read.

    Raises:
        FileError: the file is missing, unreadable, too large for `limit` or for memory.
    """
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            if size > limit:
                raise FileError(f"{path}: {size:,} bytes, but at most {limit:,} are expected here. Check the file.")
            file.seek(0)
            return file.read(size)  # not limit: read() takes that much memory at once
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise unreadable(path, error) from error
    except MemoryError as error:
        raise FileError(f"{path}: does not fit into memory. Use a smaller file or a larger machine.") from error


def is_file(path: Path) -> bool:
    """Whether the path names a file; False for names that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether the path names a folder; False for names that no folder can have."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def brief(error: Exception) -> str:
    """Shorten a library's message to what fits into one line; some quote the damaged bytes."""
    text = " ".join(str(error).split())
    return text if len(text) <= _LONGEST_MESSAGE else text[:_LONGEST_MESSAGE] + "…"


def unreadable(path: Path, error: OSError | ValueError) -> FileError:
    """Say what the system said, in one sentence that names the file."""
    match error:
        case FileNotFoundError() | NotADirectoryError():
            return FileError(f"{path}: not found. Check the path.")
        case IsADirectoryError():
            return FileError(f"{path}: is a folder, not a file. Check the path.")
        case PermissionError():
            return FileError(f"{path}: may not be read. Check its permissions.")
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return FileError(f"{path}: cannot be read ({reason}). Check the path.")
