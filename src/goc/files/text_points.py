"""Points as text, one a line (.xyz, .txt, .pts, .asc, .csv), whatever their columns mean."""

import io
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from goc.errors import FileError
from goc.files.raw_points import RawPoints, noted
from goc.files.reading import brief, read_bytes

_LIMIT = 1 << 30
_UNIT, _SHARE = 0.02, 0.98
"""Rows that are as long as 1, give or take so much, are normals if so great a share of them is."""
_NAMES = {"x": 0, "y": 1, "z": 2, "r": 3, "red": 3, "g": 4, "green": 4, "b": 5, "blue": 5} | {
    name: 6 + axis
    for axis, letter in enumerate("xyz")
    for name in (f"n{letter}", f"normal_{letter}", f"normal{letter}")
}
_WIDTHS = {3: 3, 4: 4, 6: 3, 7: 4, 9: 3, 10: 4}
"""Columns of a row, and those before its first group of three beyond x y z: a fourth is an intensity."""


def read_text_points(path: Path) -> RawPoints:
    """Read x y z a line, then any of an intensity, a colour and a normal, in any order.

    Three columns are normals if they are of length 1, else colours if they reach from 0 to 1 or from 0 to 255. A line
    of names (`X Y Z R G B Nx Ny Nz`) is believed; `#` and `//` start comments; a line with one number alone is the
    count of points, as in .pts. Commas and semicolons count as blanks.

    Raises:
        FileError: missing, not numbers in equal rows, of other counts of columns, or fewer rows than announced.
    """
    data = read_bytes(path, _LIMIT)
    lines, names, count = _lines(data)
    if not lines:
        raise FileError(f"{path}: holds no points. Write the file again.")
    try:
        rows = np.loadtxt(io.StringIO("\n".join(lines)), ndmin=2, dtype=np.float64, encoding="utf-8")
    except ValueError as error:
        raise FileError(f"{path}: not numbers in equal rows ({brief(error)}). Write x y z, a point a line.") from error
    if count is not None and count != len(rows):
        raise FileError(f"{path}: announces {count:,} points and holds {len(rows):,}. Copy or write it again.")
    if names is not None and len(names) == rows.shape[1] and {"x", "y", "z"} <= set(names):
        return _named(rows, names)
    if rows.shape[1] not in _WIDTHS:
        known = "3, 6 or 9 (x y z, r g b, nx ny nz), one more with an intensity"
        raise FileError(f"{path}: {rows.shape[1]} numbers a line; {known} are expected.")
    return _guessed(rows)


def _lines(data: bytes) -> tuple[list[str], list[str] | None, int | None]:
    """Lines with numbers; names of columns, if a line before them has some; and how many points are announced."""
    text = data.decode("utf-8", "replace").replace("\x00", "?")
    names, count, kept = None, None, []
    for line in text.splitlines():
        bare = re.split(r"#|//", line, maxsplit=1)[0].strip()
        if not kept:
            words = re.sub(r"^(#|//)+", "", line.strip()).lower().replace(",", " ").replace(";", " ").split()
            if {"x", "y", "z"} <= {re.sub(r"[^a-z_]", "", word) for word in words}:
                names = [re.sub(r"[^a-z_]", "", word) for word in words]
                continue
            if count is None and bare.isdigit() and len(bare) < 16:
                count = int(bare)
                continue
        if bare:
            kept.append(bare.replace(",", " ").replace(";", " "))
    return kept, names, count


def _named(rows: Float64[np.ndarray, "p c"], names: list[str]) -> RawPoints:
    at = {_NAMES[name]: place for place, name in reversed(list(enumerate(names))) if name in _NAMES}

    def three(first: int) -> Float64[np.ndarray, "p 3"] | None:
        wanted = [first, first + 1, first + 2]
        return rows[:, [at[one] for one in wanted]] if all(one in at for one in wanted) else None

    positions = three(0)
    assert positions is not None
    return RawPoints(positions=positions, colours=three(3), normals=three(6))


def _guessed(rows: Float64[np.ndarray, "p c"]) -> RawPoints:
    raw = RawPoints(positions=rows[:, :3])
    known = np.isfinite(raw.positions).all(axis=1)
    colours = normals = None
    for start in range(_WIDTHS[rows.shape[1]], rows.shape[1], 3):
        group = rows[:, start : start + 3]
        values = group[known & np.isfinite(group).all(axis=1)]
        unit = len(values) > 0 and (np.abs(np.linalg.norm(values, axis=1) - 1) < _UNIT).mean() >= _SHARE
        if unit and normals is None:
            normals = group
        elif len(values) and values.min() >= 0 and values.max() <= 255 and colours is None:
            colours = group
        else:
            words = "neither unit normals nor colours of 0 to 1 or 0 to 255: not used"
            raw = noted(raw, f"columns {start + 1} to {start + 3} are {words}")
    return RawPoints(positions=raw.positions, colours=colours, normals=normals, remarks=raw.remarks)
