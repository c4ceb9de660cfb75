"""Points as surveyors keep them: LAS, LAZ and E57. Needs the extra `formats`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from goc.errors import FileError
from goc.files.raw_points import RawPoints
from goc.files.reading import brief, is_file, unreadable

_MOST = 50_000_000
_CHUNK = 1_000_000
_ROW = 20
"""Least bytes of a point in LAS."""


def read_las(path: Path) -> RawPoints:
    """Read .las or .laz: positions with their scale and offset in double precision, colours where there are any.

    Raises:
        FileError: missing, damaged, of more points than an object can have, or the extra is not installed.
    """
    return _guarded(path, "LAS", _las)


def read_e57(path: Path) -> RawPoints:
    """Read the scans of an .e57 file in its common frame, with colours where all have them.

    The place of a single scan is where it was seen from.

    Raises:
        FileError: missing, damaged, of more points than an object can have, or the extra is not installed.
    """
    return _guarded(path, "E57", _e57)


def _guarded(path: Path, kind: str, read: Callable[[Path], RawPoints]) -> RawPoints:
    if not is_file(path):
        raise unreadable(path, FileNotFoundError())
    try:
        return read(path)
    except FileError:
        raise
    except ImportError as error:
        raise FileError(f"{path}: {kind} files are read by an extra. Run `pip install goc[formats]`.") from error
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # the libraries raise dozens of types; panics in Rust are no Exception
        raise FileError(f"{path}: not a readable {kind} file ({brief(error)}). Write it again.") from error


def _las(path: Path) -> RawPoints:
    import laspy  # pyright: ignore[reportMissingImports]

    with laspy.open(path) as reader:
        count, packed = reader.header.point_count, reader.header.are_points_compressed
        _check_count(path, count)
        if not packed and count * _ROW > path.stat().st_size:
            raise FileError(f"{path}: cut short: {count:,} points need more bytes than it has. Copy it again.")
        names = set(reader.header.point_format.dimension_names)
        coloured = {"red", "green", "blue"} <= names
        places, colours = [], []
        for chunk in reader.chunk_iterator(_CHUNK):
            places.append(np.stack([np.asarray(chunk[axis], np.float64) for axis in "xyz"], -1))
            if coloured:
                colours.append(np.stack([np.asarray(chunk[name]) for name in ("red", "green", "blue")], -1))
    positions = np.concatenate([np.zeros((0, 3)), *places])
    if len(positions) != count:
        raise FileError(f"{path}: announces {count:,} points and holds {len(positions):,}. Copy or write it again.")
    return RawPoints(positions=positions, colours=_any(colours))


def _e57(path: Path) -> RawPoints:
    import pye57  # pyright: ignore[reportMissingImports]

    file = pye57.E57(str(path))
    try:
        scans = [_e57_scan(file, number) for number in range(file.scan_count)] if _e57_checked(path, file) else []
        seen = np.asarray(file.scan_position(0), np.float64).reshape(3) if _has_place(file) else None
    finally:
        file.close()
    coloured = all(colours is not None for _, colours in scans)
    return RawPoints(
        positions=np.concatenate([np.zeros((0, 3)), *(places for places, _ in scans)]),
        colours=_any([colours for _, colours in scans]) if coloured else None,
        seen_from=seen,
    )


def _e57_checked(path: Path, file: Any) -> bool:
    _check_count(path, sum(file.get_header(number).point_count for number in range(file.scan_count)))
    return True


def _has_place(file: Any) -> bool:
    return file.scan_count == 1 and file.get_header(0).has_pose()


def _e57_scan(file: Any, number: int) -> tuple[np.ndarray, np.ndarray | None]:
    data = file.read_scan(number, colors=True, ignore_missing_fields=True)
    places = np.stack([np.asarray(data[f"cartesian{axis}"], np.float64) for axis in "XYZ"], -1)
    names = [f"color{name}" for name in ("Red", "Green", "Blue")]
    return places, np.stack([data[name] for name in names], -1) if all(name in data for name in names) else None


def _check_count(path: Path, count: int) -> None:
    if count > _MOST:
        raise FileError(f"{path}: {count:,} points, but an object has at most {_MOST:,}. Cut it out first.")


def _any(parts: list) -> np.ndarray | None:
    return np.concatenate(parts) if parts else None
