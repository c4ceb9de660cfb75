"""PLY (Stanford polygon format) as numpy columns.

Library readers crash or hang on damaged files, since they trust the header's counts; this one checks every count
against the bytes that are there before it allocates. Reads ascii and both binary byte orders, writes little endian.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from goc.errors import FileError
from goc.files.atomic import write_atomic
from goc.files.ply_body import Column, Lists, read_ascii, read_binary
from goc.files.ply_header import NAMES, PlyError, parse_header
from goc.files.reading import brief, read_bytes

__all__ = ["Column", "Lists", "read_ply", "write_ply"]

_LIMIT = 8 << 30


def read_ply(path: Path) -> dict[str, dict[str, Column]]:
    """Read all elements: {element: {property: column}}, columns in the types that the header names.

    Numbers are as stored: whoever uses them checks that they are finite and in range.

    Raises:
        FileError: missing, or header and content contradict each other.
    """
    data = read_bytes(path, _LIMIT)
    try:
        header = parse_header(data)
        elements: dict[str, dict[str, Column]] = {}
        if header.order:
            offset = header.size
            for element in header.elements:
                elements[element.name], offset = read_binary(data, offset, header.order, element)
            left = len(data[offset:].strip())
        else:
            words, offset = data[header.size :].split(), 0
            for element in header.elements:
                elements[element.name], offset = read_ascii(words, offset, element)
            left = len(words) - offset
        if left:
            raise PlyError(f"{left} {'bytes' if header.order else 'numbers'} more than its header announces")
    except PlyError as error:
        raise FileError(f"{path}: not a sound PLY file: {brief(error)}. Write it again.") from error
    except MemoryError as error:
        raise FileError(f"{path}: does not fit into memory. Use a smaller file or a larger machine.") from error
    return elements


def write_ply(path: Path, elements: Mapping[str, Mapping[str, np.ndarray]]) -> None:
    """Write elements as binary little endian, atomically.

    Args:
        path: where.
        elements: {element: {property: column}}; a column of shape (rows, k), k < 256, becomes a list property.
    """
    header = ["ply", "format binary_little_endian 1.0"]
    bodies = []
    for name, columns in elements.items():
        count = len(next(iter(columns.values())))
        header.append(f"element {name} {count}")
        fields: list[tuple] = []
        for key, column in columns.items():
            code = column.dtype.str[1:]
            if column.ndim == 2:
                header.append(f"property list uchar {NAMES[code]} {key}")
                fields += [(f"{key} length", "u1"), (key, f"<{code}", (column.shape[1],))]
            else:
                header.append(f"property {NAMES[code]} {key}")
                fields.append((key, f"<{code}"))
        rows = np.zeros(count, np.dtype(fields))
        for key, column in columns.items():
            rows[key] = column
            if column.ndim == 2:
                rows[f"{key} length"] = column.shape[1]
        bodies.append(rows)
    with write_atomic(path) as file:
        file.write("\n".join([*header, "end_header\n"]).encode("ascii"))
        for rows in bodies:
            file.write(rows.tobytes())
