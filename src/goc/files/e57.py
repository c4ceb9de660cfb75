"""Points as laser scanners keep them (.e57). Needs the extra `formats`."""

from pathlib import Path
from typing import Any

import numpy as np

from goc.errors import FileError
from goc.files.las import check_count
from goc.files.raw_points import RawPoints
from goc.files.reading import brief, is_file, unreadable

_COLOURS = ("colorRed", "colorGreen", "colorBlue")


def read_e57(path: Path) -> RawPoints:
    """Read the scans of an .e57 file in its common frame, with colours where all have them.

    The place of a single scan is where it was seen from.

    Raises:
        FileError: missing, damaged, of more points than an object has, or the extra is not installed.
    """
    if not is_file(path):
        raise unreadable(path, FileNotFoundError())
    try:
        import pye57  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise FileError(f"{path}: .e57 is read by an extra. Run `pip install goc[formats]`.") from error
    try:
        file = pye57.E57(str(path))
        try:
            return _points(path, file)
        finally:
            file.close()
    except FileError:
        raise
    except Exception as error:  # the library raises its own kinds
        raise FileError(f"{path}: not a readable E57 file ({brief(error)}). Write it again.") from error


def _points(path: Path, file: Any) -> RawPoints:
    count = file.scan_count
    check_count(path, sum(file.get_header(number).point_count for number in range(count)))
    scans = [file.read_scan(number, colors=True, ignore_missing_fields=True) for number in range(count)]
    coloured = bool(scans) and all(name in scan for scan in scans for name in _COLOURS)
    one = count == 1 and file.get_header(0).has_pose()
    return RawPoints(
        positions=np.concatenate([np.zeros((0, 3)), *(_columns(scan, "cartesian", "XYZ") for scan in scans)]),
        colours=np.concatenate([_columns(scan, "", _COLOURS) for scan in scans]) if coloured else None,
        seen_from=np.asarray(file.scan_position(0), np.float64).reshape(3) if one else None,
    )


def _columns(scan: dict[str, np.ndarray], stem: str, names: tuple[str, ...] | str) -> np.ndarray:
    return np.stack([np.asarray(scan[stem + name]) for name in names], axis=-1)
