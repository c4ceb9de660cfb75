"""JSON under strict schemas, and small text matrices."""

from pathlib import Path
from types import GenericAlias
from typing import Any, TypeVar

import msgspec
import numpy as np
from jaxtyping import Float64

from goc.errors import FileError
from goc.files.atomic import write_bytes
from goc.files.reading import brief, read_bytes

T = TypeVar("T")
_JSON_LIMIT = 256 << 20
_MATRIX_LIMIT = 1 << 16
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


class _Versioned(msgspec.Struct):
    schema: int = 0
    """Files of before there were versions have none."""


def read_json(path: Path, schema: type[T] | GenericAlias) -> T:
    """Decode a JSON file into the type that describes it.

    Args:
        path: UTF-8, with or without byte order mark.
        schema: a msgspec.Struct, dataclass or plain annotation such as dict[str, str].

    Raises:
        FileError: missing, not JSON, or not of this schema; the text names the place inside, such as `$.frames[0].w`.
    """
    data = read_bytes(path, _JSON_LIMIT).removeprefix(_BYTE_ORDER_MARK)
    try:
        return msgspec.json.decode(data, type=schema)
    except RecursionError as error:
        raise FileError(f"{path}: nested too deeply. Check the file.") from error
    except msgspec.ValidationError as error:
        raise FileError(f"{path}: {brief(error)}. Correct this entry.") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise FileError(f"{path}: not valid JSON ({brief(error)}). Write the file again.") from error


def read_versioned(path: Path, schema: type[T], version: int, remedy: str) -> T:
    """Decode a JSON file that carries its schema's version under `schema`, and refuse other versions by name.

    Args:
        path: as `read_json` takes it.
        schema: of `version`, with a field `schema`.
        version: the only one that is read.
        remedy: what to do with a file of an older goc, without a full stop.

    Raises:
        FileError: as `read_json`, or the file is of another version.
    """
    found = read_json(path, _Versioned).schema
    if found > version:
        raise FileError(f"{path}: has schema {found}, and this goc reads {version}. Read it with a newer goc.")
    if found < version:
        raise FileError(f"{path}: has schema {found} of an older goc, and this one reads {version}. {remedy}.")
    return read_json(path, schema)


def write_json(path: Path, value: object) -> None:
    """Write dataclasses, structs, dicts and numbers as indented JSON, atomically; NaN and infinity become null."""
    encoded = msgspec.json.encode(value, enc_hook=_plain)
    write_bytes(path, msgspec.json.format(encoded, indent=2) + b"\n")


def as_json(value: object) -> Any:
    """Convert dataclasses, structs, paths and tuples to what JSON has: dicts, lists, texts and numbers."""
    return msgspec.json.decode(msgspec.json.encode(value, enc_hook=_plain))


def read_matrix(path: Path, *, finite: bool = True, limit: int = _MATRIX_LIMIT) -> Float64[np.ndarray, "rows columns"]:
    """Read rows of numbers separated by blanks or commas.

    Args:
        path: ASCII text.
        finite: refuse NaN and infinity, by which some formats mark poses that were lost.
        limit: most bytes to take.

    Raises:
        FileError: missing, too large, not numbers, rows of different length, or a number that is not finite.
    """
    try:
        lines = read_bytes(path, limit).decode("ascii").replace(",", " ").splitlines()
        rows = [[float(word) for word in line.split()] for line in lines if line.split()]
    except ValueError as error:  # UnicodeDecodeError is one
        raise FileError(f"{path}: expected only numbers ({brief(error)}). Write the file again.") from error
    widths = {len(row) for row in rows}
    if len(widths) != 1:
        found = "nothing" if not rows else f"rows of {' and '.join(map(str, sorted(widths)))} numbers"
        raise FileError(f"{path}: expected a matrix, found {found}. Write the file again.")
    matrix = np.array(rows, np.float64)
    if finite and not np.isfinite(matrix).all():
        raise FileError(
            f"{path}: {(~np.isfinite(matrix)).sum()} numbers are not finite. Remove this view or correct it."
        )
    return matrix


def _plain(value: Any) -> Any:
    """What msgspec does not know: paths and numpy or torch scalars."""
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "item"):
        return value.item()
    raise NotImplementedError(f"{type(value).__name__} has no JSON form")
