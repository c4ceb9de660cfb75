"""Decodes buffers of EXT_meshopt_compression: vertices (version 0 of the codec), triangles, and index sequences.

Written from the extension's specification (Khronos, EXT_meshopt_compression, appendix A and B).
"""

import numpy as np
from jaxtyping import UInt8, UInt32

_GROUP = 16
_BLOCK_BYTES, _BLOCK_ROWS = 8192, 256
_TAIL = 32
_BITS = (0, 2, 4, 8)
_QUEUE = 16
_RESTART = 0xF0
"""From this code on a triangle shares no edge with one of the last sixteen."""


def decode_attributes(data: bytes, count: int, stride: int) -> UInt8[np.ndarray, "{count} {stride}"]:
    """Rows of bytes: each byte is kept as its difference from the row before, in groups of 16 of as few bits as do.

    Args:
        data: as stored.
        count: rows.
        stride: bytes a row, a multiple of 4 up to 256.

    Raises:
        ValueError: another version of the codec, or data that end too early or too late.
    """
    if not data or data[0] != 0xA0:
        raise ValueError("a vertex buffer of another version of the meshopt codec")
    if not 0 < stride <= 256 or stride % 4:
        raise ValueError(f"rows of {stride} bytes")
    end = len(data) - max(stride, _TAIL)
    rows = min((_BLOCK_BYTES // stride) & ~(_GROUP - 1), _BLOCK_ROWS)
    stored = np.frombuffer(data, np.uint8)
    result = np.zeros((count, stride), np.uint8)
    last, place = stored[len(data) - stride :], 1
    for start in range(0, count, rows):
        block = result[start : start + rows]
        for column in range(stride):
            codes, place = _byte_column(data, stored, place, end, len(block))
            steps = (codes >> 1) ^ (0 - (codes & 1))
            block[:, column] = last[column] + np.cumsum(steps, dtype=np.uint8)
        last = block[-1]
    if place != end:
        raise ValueError("a vertex buffer that does not end where its rows do")
    return result


def _byte_column(
    data: bytes, stored: UInt8[np.ndarray, "n"], place: int, end: int, rows: int
) -> tuple[UInt8[np.ndarray, "{rows}"], int]:
    """One byte of each row of a block, and where the next begins."""
    groups = -(-rows // _GROUP)
    header = place
    place += -(-groups // 4)
    codes = np.zeros(groups * _GROUP, np.uint8)
    for group in range(groups):
        if place > end:
            raise ValueError("a vertex buffer that is cut short")
        bits = _BITS[data[header + group // 4] >> 2 * (group % 4) & 3]
        if bits == 0:
            continue
        packed = stored[place : place + 2 * bits]
        place += 2 * bits
        if bits == 8:
            values = packed
        else:
            shifts = np.arange(8 - bits, -1, -bits, dtype=np.uint8)
            most = np.uint8((1 << bits) - 1)
            values = ((packed[:, None] >> shifts) & most).ravel()
            wide = np.flatnonzero(values == most)  # these follow in a byte each
            values[wide] = stored[place : place + len(wide)]
            place += len(wide)
        codes[group * _GROUP : (group + 1) * _GROUP] = values
    if place > end:
        raise ValueError("a vertex buffer that is cut short")
    return codes[:rows], place


def undo_exponents(rows: UInt8[np.ndarray, "n s"]) -> UInt8[np.ndarray, "n s"]:
    """The filter EXPONENTIAL: words of an 8-bit power of two and a 24-bit whole number become floats."""
    words = rows.view("<i4")
    with np.errstate(over="ignore"):
        values = np.ldexp(((words << 8) >> 8).astype(np.float64), words >> 24).astype("<f4")
    return values.view(np.uint8)


class _Source:
    """Numbers of seven bits a byte, and differences from the last one."""

    def __init__(self, data: bytes, place: int, end: int) -> None:
        self.data, self.place, self.end = data, place, end

    def byte(self) -> int:
        if self.place >= self.end:
            raise ValueError("an index buffer that is cut short")
        self.place += 1
        return self.data[self.place - 1]

    def number(self) -> int:
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128 or shift > 35:
                return value

    def difference(self) -> int:
        value = self.number()
        return (value >> 1) ^ -(value & 1)


def decode_triangles(data: bytes, count: int) -> UInt32[np.ndarray, "{count}"]:
    """Corners of triangles, three each: most share an edge with one of the sixteen before, by a code of a byte.

    Raises:
        ValueError: another version of the codec, or data that are cut short.
    """
    if not data or data[0] not in (0xE0, 0xE1) or count % 3:
        raise ValueError("an index buffer of another version of the meshopt codec")
    triangles = count // 3
    if 1 + triangles + _QUEUE > len(data):
        raise ValueError("an index buffer that is cut short")
    source = _Source(data, 1 + triangles, len(data) - _QUEUE)
    return np.array(_triangles(data, triangles, source, 13 if data[0] == 0xE1 else 15), np.int64).astype(np.uint32)


def _triangles(data: bytes, count: int, source: _Source, known: int) -> list[int]:
    edges, recent = [(0, 0)] * _QUEUE, [0] * _QUEUE  # the newest last
    table = data[len(data) - _QUEUE :]
    fresh = last = 0
    result: list[int] = []
    for code in data[1 : 1 + count]:
        if code < _RESTART:
            a, b = edges[-1 - (code >> 4)]
            way = code & 15
            new = way == 0 or way >= known
            if way == 0:
                c, fresh = fresh, fresh + 1
            elif way < known:
                c = recent[-1 - way]
            else:
                last += source.difference() if way == 15 else (-1 if way == 13 else 1)
                c = last
            pushed, sides = [c] if new else [], [(c, b), (a, c)]
        else:
            explicit = code >= 0xFE
            ways = source.byte() if explicit else table[code & 15]
            if explicit and ways == 0:
                fresh = 0
            corners, pushed = [], []
            for way in (15 if code == 0xFF else 0, ways >> 4, ways & 15):
                if way == 0:
                    corner, fresh = fresh, fresh + 1
                elif explicit and way == 15:
                    last += source.difference()
                    corner = last
                else:
                    corner = recent[-way]
                if way == 0 or (explicit and way == 15):
                    pushed.append(corner)
                corners.append(corner)
            a, b, c = corners
            sides = [(b, a), (c, b), (a, c)]
        recent += pushed
        edges += sides
        if len(edges) > 4096:
            del edges[:-_QUEUE], recent[:-_QUEUE]
        result += (a, b, c)
    return result


def decode_indices(data: bytes, count: int) -> UInt32[np.ndarray, "{count}"]:
    """A sequence of indices, each kept as its difference from one of two before.

    Raises:
        ValueError: another version of the codec, or data that are cut short.
    """
    if not data or data[0] not in (0xD0, 0xD1):
        raise ValueError("an index sequence of another version of the meshopt codec")
    source, last, result = _Source(data, 1, len(data) - 4), [0, 0], np.zeros(count, np.int64)
    for place in range(count):
        value = source.number()
        which, step = value & 1, value >> 1
        last[which] += (step >> 1) ^ -(step & 1)
        result[place] = last[which]
    return result.astype(np.uint32)
