"""Encoders of EXT_meshopt_compression: the plainest ones that its specification allows."""

import numpy as np

_TABLE = (0x00, 0x76, 0x87, 0x56, 0x67, 0x78, 0xA9, 0x86, 0x65, 0x89, 0x68, 0x98, 0x01, 0x69, 0, 0)


def encoded_attributes(rows):
    """Rows of bytes (n, stride): each group of 16 differences in as few bits as do."""
    count, stride = rows.shape
    block = min((8192 // stride) & ~15, 256)
    out, last = bytearray([0xA0]), rows[0]
    for start in range(0, count, block):
        part = rows[start : start + block]
        steps = np.diff(part, axis=0, prepend=last[None]).astype(np.int8).astype(np.int64)
        codes = np.where(steps < 0, -2 * steps - 1, 2 * steps)
        codes = np.pad(codes, [(0, -len(part) % 16), (0, 0)])
        for column in range(stride):
            out += _column(codes[:, column].reshape(-1, 16))
        last = part[-1]
    return bytes(out) + b"\0" * max(32 - stride, 0) + rows[0].tobytes()


def _column(groups):
    packed = [min((_group(group, bits) for bits in (0, 2, 4, 8)), key=lambda made: len(made[1])) for group in groups]
    header = np.zeros(-(-len(packed) // 4), np.uint8)
    for place, (bits, _) in enumerate(packed):
        header[place // 4] |= (0, 2, 4, 8).index(bits) << 2 * (place % 4)
    return header.tobytes() + b"".join(data for _, data in packed)


def _group(codes, bits):
    if bits == 0:
        return 0, b"" if not codes.any() else b"x" * 99
    if bits == 8:
        return 8, bytes(codes.astype(np.uint8))
    most = (1 << bits) - 1
    whole = 0
    for code in codes:
        whole = whole << bits | min(int(code), most)
    return bits, whole.to_bytes(2 * bits, "big") + bytes(int(code) for code in codes if code >= most)


def encoded_triangles(faces):
    """Corners (t, 3), in their order: shared edges where the last ones have them, else corners of their own."""
    edges, recent, codes, data = [(0, 0)] * 16, [0] * 16, bytearray(), bytearray()
    fresh = last = 0

    def difference(value):
        nonlocal last
        step, last = value - last, value
        rest = -2 * step - 1 if step < 0 else 2 * step
        while rest > 127:
            data.append(rest & 127 | 128)
            rest >>= 7
        data.append(rest)

    for a, b, c in np.asarray(faces).tolist():
        near = edges[-1:-16:-1]
        if (a, b) in near:
            if c == fresh:
                way, fresh = 0, fresh + 1
            elif c in recent[-2:-14:-1]:
                way = recent[-2:-14:-1].index(c) + 1
            elif c in (last - 1, last + 1):
                way, last = (13 if c < last else 14), c
            else:
                way = 15
                difference(c)
            codes.append(near.index((a, b)) << 4 | way)
            recent += [c] * (way == 0 or way >= 13)
            edges += [(c, b), (a, c)]
            continue
        ways, pushed, start = [], [], fresh
        for corner in (a, b, c):
            if corner == fresh and (corner != c or ways != [15, 0]):
                fresh += 1
                ways.append(0)
                pushed.append(corner)
            elif ways and corner in recent[-1:-15:-1]:
                ways.append(recent[-1:-15:-1].index(corner) + 1)
            else:
                ways.append(15)
                pushed.append(corner)
        both = ways[1] << 4 | ways[2]
        if ways[0] == 0 and both in _TABLE[:14]:
            codes.append(0xF0 | _TABLE.index(both))
        else:
            assert both or start == 0
            codes.append(0xFE if ways[0] == 0 else 0xFF)
            data.append(both)
            for way, corner in zip(ways, (a, b, c), strict=True):
                if way == 15:
                    difference(corner)
        recent += pushed
        edges += [(b, a), (c, b), (a, c)]
    return bytes([0xE1]) + bytes(codes) + bytes(data) + bytes(_TABLE)
