"""Point clouds as PCL writes them (.pcd): positions, colours, normals, and the place that they were seen from."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from goc.errors import FileError
from goc.files.raw_points import RawPoints
from goc.files.reading import brief, read_bytes

_LIMIT = 1 << 30
_KINDS = {"F": "f", "U": "u", "I": "i"}
_NORMAL = ("normal_x", "normal_y", "normal_z")


def read_pcd(path: Path) -> RawPoints:
    """Read a PCD file of any of its three encodings (https://pointclouds.org/documentation: PCD 0.7).

    Points without a finite position, with which organised clouds are filled up, are kept. The translation of VIEWPOINT
    is where the points were seen from, unless it is the default 0 0 0, which tells nothing.

    Raises:
        FileError: missing, or damaged.
    """
    data = read_bytes(path, _LIMIT)
    try:
        header, body = _header(data)
        table = _table(header, body)
        positions = _columns(table, ("x", "y", "z"))
        place = [float(value) for value in header.get("VIEWPOINT", ["0"] * 7)[:3]]
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise FileError(f"{path}: not a readable PCD file ({brief(error)}). Write it again.") from error
    normals = _columns(table, _NORMAL) if all(name in table for name in _NORMAL) else None
    return RawPoints(
        positions=positions if positions.dtype.kind == "f" else positions.astype(np.float64),
        colours=_colours(table),
        normals=normals,
        seen_from=np.array(place) if any(place) and np.isfinite(place).all() else None,
    )


def _header(data: bytes) -> tuple[dict[str, list[str]], bytes]:
    """Entries of the header by name, and what follows it."""
    entries: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in entries:
        end = data.index(b"\n", start)
        words = data[start:end].decode("ascii").split()
        if words and not words[0].startswith("#"):
            entries[words[0]] = words[1:]
        start = end + 1
    return entries, data[start:]


def _table(header: Mapping[str, list[str]], body: bytes) -> dict[str, np.ndarray]:
    """Columns by the name of their field; of fields with several values, the first."""
    names, sizes = header["FIELDS"], [int(size) for size in header["SIZE"]]
    counts = [int(count) for count in header.get("COUNT", ["1"] * len(names))]
    kinds = [np.dtype(f"<{_KINDS[kind]}{size}") for kind, size in zip(header["TYPE"], sizes, strict=True)]
    points = int(header["POINTS"][0])
    fields = list(zip(names, kinds, counts, strict=True))
    match header["DATA"][0]:
        case "ascii":
            rows = np.loadtxt(body.decode("ascii").splitlines(), ndmin=2, dtype=np.float64)[:points]
            starts = np.cumsum([0, *counts])
            return {name: _typed(rows[:, at], kind) for (name, kind, _), at in zip(fields, starts, strict=False)}
        case "binary":
            row = np.dtype([(f"f{place}", kind, (count,)) for place, (_, kind, count) in enumerate(fields)])
            found = np.frombuffer(body, row, points)
            return {name: found[f"f{place}"][:, 0] for place, name in enumerate(names)}
        case "binary_compressed":
            packed, size = (int(number) for number in np.frombuffer(body, "<u4", 2))
            whole, at, table = _decompressed(body[8 : 8 + packed], size), 0, {}
            for name, kind, count in fields:
                table[name] = np.frombuffer(whole, kind, points * count, at).reshape(points, count)[:, 0]
                at += points * count * kind.itemsize
            return table
    raise ValueError(f"DATA {header['DATA'][0]}")


def _typed(column: np.ndarray, kind: np.dtype) -> np.ndarray:
    """A column of text as its field has it. Old files write packed colours as the float of the same bits."""
    return column.astype(kind) if np.isfinite(column).all() else column


def _columns(table: Mapping[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray:
    return np.stack([table[name] for name in names], axis=-1)


def _colours(table: Mapping[str, np.ndarray]) -> UInt8[np.ndarray, "p 3"] | None:
    packed = table.get("rgb", table.get("rgba"))
    if packed is None:
        return None
    bits = packed.astype(np.float32).view(np.uint32) if packed.dtype.kind == "f" else packed.astype(np.uint32)
    return np.stack([bits >> 16, bits >> 8, bits], axis=-1).astype(np.uint8)


def _decompressed(packed: bytes, size: int) -> bytes:
    """LZF (Lehmann's liblzf): runs of literal bytes, and copies of what was written before."""
    written = bytearray()
    at = 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < 32:
            written += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        start = len(written) - ((control & 31) << 8) - packed[at] - 1
        at += 1
        if start < 0:
            raise ValueError("a copy of what is not there")
        for place in range(start, start + length + 2):  # may overlap what it writes
            written.append(written[place])
    if len(written) != size:
        raise ValueError(f"{len(written)} bytes came out, {size} were announced")
    return bytes(written)
