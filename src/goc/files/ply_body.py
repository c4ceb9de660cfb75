"""The numbers of a PLY file, element by element."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64, Shaped

from goc.files.ply_header import Element, PlyError, Property
from goc.files.reading import brief

_LONGEST_NUMBER = 64
_LARGEST_ROW = 1 << 30  # numpy counts the bytes of a row in 32 bits


@dataclass(frozen=True, kw_only=True, eq=False)
class Lists:
    """A list property: rows of any length, end to end."""

    counts: Int64[np.ndarray, "rows"]
    values: Shaped[np.ndarray, "items"]


Column = np.ndarray | Lists


def read_binary(data: bytes, offset: int, order: str, element: Element) -> tuple[dict[str, Column], int]:
    """Read one element's rows from `offset`; returns its columns and the offset behind it."""
    smallest = sum(np.dtype(item.count_code or item.code).itemsize for item in element.properties)
    _check_room(element, element.count * smallest, len(data) - offset, "bytes")
    if not element.count:
        return {item.name: _empty(item) for item in element.properties}, offset
    lengths = _first_lengths(data, offset, order, element)
    dtype = _row_type(element, lengths, order, largest=len(data))
    if dtype is not None and element.count * dtype.itemsize <= len(data) - offset:
        rows = np.frombuffer(data, dtype, element.count, offset)
        uniform = all((rows[f"{name} length"] == length).all() for name, length in lengths.items())
        if uniform:
            return _columns(rows, element, lengths), offset + element.count * dtype.itemsize
    return _read_ragged(data, offset, order, element)


def read_ascii(words: list[bytes], offset: int, element: Element) -> tuple[dict[str, Column], int]:
    """Read one element's rows from word `offset`; returns its columns and the offset behind it."""
    width = len(element.properties)
    _check_room(element, element.count * width, len(words) - offset, "numbers")
    if all(item.count_code is None for item in element.properties):
        end = offset + element.count * width
        table = _numbers(words[offset:end], element).reshape(element.count, width)
        columns = {item.name: _as_type(table[:, i], item) for i, item in enumerate(element.properties)}
        return dict(columns), end
    return _read_ascii_ragged(words, offset, element)


def _empty(item: Property) -> Column:
    values = np.zeros(0, item.code)
    return values if item.count_code is None else Lists(counts=np.zeros(0, np.int64), values=values)


def _check_room(element: Element, wanted: int, there: int, unit: str) -> None:
    if wanted > there:
        raise PlyError(
            f"cut short or damaged: {element.count} rows of {element.name} need {wanted} {unit}, "
            f"{max(there, 0)} are there"
        )


def _first_lengths(data: bytes, offset: int, order: str, element: Element) -> dict[str, int]:
    """Lengths of the lists in the first row: nearly always those of all rows."""
    lengths = {}
    for item in element.properties:
        length = 1
        if item.count_code is not None:
            length = _length_at(data, offset, order, element, item)
            lengths[item.name] = length
            offset += np.dtype(item.count_code).itemsize
        offset += length * np.dtype(item.code).itemsize
    return lengths


def _length_at(data: bytes, offset: int, order: str, element: Element, item: Property) -> int:
    count_type = np.dtype(order + str(item.count_code))
    _check_room(element, count_type.itemsize, len(data) - offset, "more bytes")
    length = int(np.frombuffer(data, count_type, 1, offset)[0])
    if length < 0:
        raise PlyError(f"a list {item.name} of {element.name} has length {length}")
    return length


def _row_type(element: Element, lengths: dict[str, int], order: str, largest: int) -> np.dtype | None:
    """The structured type of a row whose lists have these lengths, or None if a row would exceed the file."""
    fields = []
    size = 0
    for item in element.properties:
        length = lengths.get(item.name, 1)
        size += length * np.dtype(item.code).itemsize
        if item.count_code is None:
            fields.append((item.name, order + item.code))
        else:
            fields.append((f"{item.name} length", order + item.count_code))  # no property name holds a blank
            fields.append((item.name, order + item.code, (length,)))
    return np.dtype(fields) if size <= min(largest, _LARGEST_ROW) else None


def _columns(rows: np.ndarray, element: Element, lengths: dict[str, int]) -> dict[str, Column]:
    columns: dict[str, Column] = {}
    for item in element.properties:
        values = rows[item.name].astype(item.code)  # a contiguous copy in the machine's byte order
        if item.count_code is None:
            columns[item.name] = values
        else:
            counts = np.full(element.count, lengths[item.name], np.int64)
            columns[item.name] = Lists(counts=counts, values=values.reshape(-1))
    return columns


def _read_ragged(data: bytes, offset: int, order: str, element: Element) -> tuple[dict[str, Column], int]:
    """Row by row, for lists of different lengths."""
    pieces: dict[str, list[bytes]] = {item.name: [] for item in element.properties}
    counts: dict[str, list[int]] = {item.name: [] for item in element.properties if item.count_code}
    sizes = [np.dtype(item.code).itemsize for item in element.properties]
    for _ in range(element.count):
        for item, size in zip(element.properties, sizes, strict=True):
            if item.count_code is not None:
                length = _length_at(data, offset, order, element, item)
                counts[item.name].append(length)
                offset += np.dtype(item.count_code).itemsize
                size *= length
            _check_room(element, size, len(data) - offset, "more bytes")
            pieces[item.name].append(data[offset : offset + size])
            offset += size
    columns: dict[str, Column] = {}
    for item in element.properties:
        values = np.frombuffer(b"".join(pieces[item.name]), order + item.code).astype(item.code)
        columns[item.name] = (
            values if item.count_code is None else Lists(counts=np.array(counts[item.name], np.int64), values=values)
        )
    return columns, offset


def _read_ascii_ragged(words: list[bytes], offset: int, element: Element) -> tuple[dict[str, Column], int]:
    gathered: dict[str, list[bytes]] = {item.name: [] for item in element.properties}
    counts: dict[str, list[int]] = {item.name: [] for item in element.properties if item.count_code}
    for _ in range(element.count):
        for item in element.properties:
            length = 1
            if item.count_code is not None:
                _check_room(element, 1, len(words) - offset, "more numbers")
                word = words[offset]
                if not word.isdigit() or len(word) > 9:
                    raise PlyError(f"a list {item.name} of {element.name} has length {word[:20]!r}")
                length = int(word)
                counts[item.name].append(length)
                offset += 1
            _check_room(element, length, len(words) - offset, "more numbers")
            gathered[item.name].extend(words[offset : offset + length])
            offset += length
    columns: dict[str, Column] = {}
    for item in element.properties:
        values = _as_type(_numbers(gathered[item.name], element), item)
        columns[item.name] = (
            values if item.count_code is None else Lists(counts=np.array(counts[item.name], np.int64), values=values)
        )
    return columns, offset


def _numbers(words: list[bytes], element: Element) -> Shaped[np.ndarray, "words"]:
    if max(map(len, words), default=0) > _LONGEST_NUMBER:  # numpy pads every word to the longest
        raise PlyError(f"a number of {element.name} has more than {_LONGEST_NUMBER} characters")
    try:
        return np.array(words, dtype=f"S{_LONGEST_NUMBER}").astype(np.float64)
    except ValueError as error:
        raise PlyError(f"{element.name} holds something that is not a number ({brief(error)})") from error


def _as_type(values: Shaped[np.ndarray, "rows"], item: Property) -> Shaped[np.ndarray, "rows"]:
    """Numbers in the property's type; integers must be integers, and within range."""
    if item.code.startswith("f"):
        with np.errstate(over="ignore"):  # infinity says it: whoever uses the numbers checks that they are finite
            return values.astype(item.code)
    limits = np.iinfo(item.code)
    good = (values == np.rint(values)) & (values >= limits.min) & (values <= limits.max)  # False for NaN
    if not good.all():
        raise PlyError(
            f"property {item.name} is {values[~good][0]:g} in {(~good).sum()} rows, not a {item.code} integer"
        )
    return values.astype(item.code)
