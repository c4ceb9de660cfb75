"""The text at the start of a PLY file: what elements follow, and in which types."""

from dataclasses import dataclass

TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
"""PLY's type names, in numpy's words."""

NAMES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}
"""The names every reader knows."""

_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LIMIT = 1 << 16
_END = b"end_header"


class PlyError(ValueError):
    """What is wrong with a PLY file, without its name."""


@dataclass(frozen=True)
class Property:
    """A column: one number a row, or a list of numbers a row."""

    name: str
    code: str
    """numpy code without byte order, such as f4."""
    count_code: str | None = None
    """Type of a list's length; None for a plain column."""


@dataclass(frozen=True)
class Element:
    """A table: vertices, faces, …."""

    name: str
    count: int
    properties: tuple[Property, ...]


@dataclass(frozen=True)
class Header:
    """What follows the header."""

    order: str
    """numpy byte order "<" or ">"; "" for ascii."""
    elements: tuple[Element, ...]
    size: int
    """Bytes before the body."""


def parse_header(data: bytes) -> Header:
    """Parse the header at the start of a file.

    Raises:
        PlyError: not a PLY header, or one that nothing sensible follows.
    """
    if data[:3] != b"ply" or data[3:4] not in (b"\n", b"\r"):
        raise PlyError("does not start with the word ply")
    end = data.find(_END, 0, _LIMIT)
    newline = data.find(b"\n", end, end + 16)
    if end < 0 or newline < 0:
        raise PlyError("its header has no end")
    try:
        lines = data[:newline].decode("ascii").splitlines()[1:-1]
    except UnicodeDecodeError as error:
        raise PlyError(f"its header is not ascii (byte {error.start})") from error
    order: str | None = None
    elements: list[tuple[str, int, list[Property]]] = []
    for line in lines:
        match line.split():
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case ["format", form, "1.0"] if form in _BYTE_ORDERS and order is None:
                order = _BYTE_ORDERS[form]
            case ["element", name, count] if _is_count(count) and name not in {known[0] for known in elements}:
                elements.append((name, int(count), []))
            case ["property", *words] if elements:
                _add_property(elements[-1][2], words, line)
            case _:
                raise PlyError(f"header line not understood: {line[:80]!r}")
    if order is None:
        raise PlyError("its header names no format")
    return Header(order, tuple(_finished(*element) for element in elements), newline + 1)


def _is_count(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) <= 15


def _add_property(properties: list[Property], words: list[str], line: str) -> None:
    match words:
        case ["list", count_type, item_type, name] if count_type in TYPES and item_type in TYPES:
            made = Property(name, TYPES[item_type], TYPES[count_type])
        case [item_type, name] if item_type in TYPES:
            made = Property(name, TYPES[item_type])
        case _:
            raise PlyError(f"header line not understood: {line[:80]!r}")
    if made.count_code and made.count_code.startswith("f"):
        raise PlyError(f"list {made.name} has a length that is not an integer")
    if made.name in {known.name for known in properties}:
        raise PlyError(f"property {made.name} occurs twice")
    properties.append(made)


def _finished(name: str, count: int, properties: list[Property]) -> Element:
    if count and not properties:
        raise PlyError(f"element {name} has {count} rows but no properties")
    return Element(name, count, tuple(properties))
