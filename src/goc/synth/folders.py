"""The folder that a capture is written into."""

from pathlib import Path

from goc.errors import ExportError


def check_new(folder: Path) -> None:
    """Check that a folder is absent or empty.

    Raises:
        ExportError: it is a file, or holds something.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ExportError(f"{folder}: not an empty folder. Name another one, or remove it first.")
