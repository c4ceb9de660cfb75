"""What a .glb or .gltf file holds: its document, and the bytes of its buffer views, also compressed ones."""

import base64
import binascii
import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import msgspec

from goc.files.meshopt import decode_attributes, decode_indices, decode_triangles, undo_exponents
from goc.files.reading import is_file, read_bytes

MESHOPT = "EXT_meshopt_compression"
_LIMIT = 1 << 30
_LEAST, _TIMES = 64 << 20, 64
"""Decoded numbers may take 64 MB, or 64 times what the file does: a small file that holds more is a bomb."""


class GltfError(ValueError):
    """What is wrong with a glTF file, without its name; a whole sentence where a remedy is known."""


@dataclass(frozen=True, kw_only=True)
class Gltf:
    """A glTF document, and where its bytes are."""

    path: Path
    document: dict[str, Any]
    body: bytes
    """The binary chunk of a .glb."""

    @cached_property
    def allowance(self) -> int:
        """Bytes that everything decoded may take."""
        return max(_LEAST, _TIMES * (len(self.body) + sum(len(buffer) for buffer in self._buffers.values())))

    @cached_property
    def _buffers(self) -> dict[int, bytes]:
        """Buffers with content; what only compressed views are unpacked into has none."""
        found = {}
        for number, entry in enumerate(self.entries("buffers")):
            if "uri" in entry:
                found[number] = self.resource(entry["uri"])
            elif number == 0 and self.body:
                found[number] = self.body
        return found

    def entries(self, name: str) -> list[dict[str, Any]]:
        """A list of the document, empty if it is not there."""
        found = self.document.get(name, [])
        if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
            raise GltfError(f"its {name} are no list of objects")
        return found

    def entry(self, name: str, number: object) -> dict[str, Any]:
        """One entry of a list of the document."""
        found = self.entries(name)
        if not isinstance(number, int) or not 0 <= number < len(found):
            raise GltfError(f"it names {number} of its {len(found)} {name}")
        return found[number]

    def resource(self, uri: object) -> bytes:
        """Bytes that the document keeps elsewhere: in the text itself, or in a file of its own folder or below.

        Raises:
            GltfError: outside of that folder, on a network, or not there.
        """
        if not isinstance(uri, str):
            raise GltfError("it names a file by something that is no text")
        if uri.startswith("data:"):
            head, _, text = uri.partition(",")
            if not head.endswith(";base64"):
                raise GltfError("data that are not base64")
            try:
                return base64.b64decode(text, validate=True)
            except (binascii.Error, ValueError) as error:
                raise GltfError("data that are not base64") from error
        path = self.path.parent / unquote(uri)
        if "://" in uri or not path.resolve().is_relative_to(self.path.parent.resolve()):
            raise GltfError("It names a file outside its own folder. Put all its files into one folder.")
        if not is_file(path):
            raise GltfError(f"Its file {unquote(uri)[:80]!r} is missing. Put it beside this one, or export a .glb.")
        return read_bytes(path, _LIMIT)

    def view(self, number: object) -> tuple[bytes, int | None]:
        """Bytes of a buffer view, unpacked, and its stride if it has one."""
        entry = self.entry("bufferViews", number)
        packed = entry.get("extensions", {}).get(MESHOPT)
        if packed is None:
            return self._slice(entry), entry.get("byteStride")
        count, stride = whole(packed, "count"), whole(packed, "byteStride")
        if count * stride > self.allowance:
            raise GltfError(f"a compressed view of {count * stride:,} bytes in a much smaller file")
        return _unpacked(self._slice(packed), packed, count, stride), entry.get("byteStride")

    def _slice(self, entry: dict[str, Any]) -> bytes:
        buffer = self._buffers.get(whole(entry, "buffer"), b"")
        start, length = whole(entry, "byteOffset", 0), whole(entry, "byteLength")
        if start + length > len(buffer):
            raise GltfError(f"cut short: a view ends at byte {start + length:,} of {len(buffer):,}")
        return buffer[start : start + length]


def parse_gltf(path: Path, data: bytes) -> Gltf:
    """Read the container of a .glb, or the text of a .gltf.

    Raises:
        GltfError: neither.
    """
    text, body = (data, b"") if data[:4] != b"glTF" else _chunks(data)
    try:
        document = msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise GltfError(f"its document is no JSON ({error})") from error
    if not isinstance(document, dict):
        raise GltfError("its document is no JSON object")
    version = document.get("asset", {}).get("version") if isinstance(document.get("asset"), dict) else None
    if not isinstance(version, str) or not version.startswith("2"):
        raise GltfError("It is not of version 2 of glTF. Export it again.")
    return Gltf(path=path, document=document, body=body)


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    if len(data) < 20 or struct.unpack_from("<I", data, 4)[0] != 2:
        raise GltfError("cut short, or not of version 2")
    found, at = {}, 12
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + length > len(data):
            raise GltfError(f"cut short: {len(data):,} bytes, its chunks need {at + 8 + length:,}")
        found.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length
    if b"JSON" not in found:
        raise GltfError("it has no document")
    return found[b"JSON"], found.get(b"BIN\0", b"")


def whole(entry: dict[str, Any], name: str, default: int | None = None) -> int:
    """A whole number, 0 or more, of an entry."""
    value = entry.get(name, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise GltfError(f"{name} is {str(value)[:40]!r}")
    return value


def _unpacked(data: bytes, packed: dict[str, Any], count: int, stride: int) -> bytes:
    mode, kind = packed.get("mode"), packed.get("filter", "NONE")
    if mode == "ATTRIBUTES":
        rows = decode_attributes(data, count, stride)
        if kind == "EXPONENTIAL":
            rows = undo_exponents(rows)
        elif kind != "NONE":  # of directions only, which goc does not read
            raise GltfError(f"positions or colours packed by the filter {str(kind)[:40]!r}")
        return rows.tobytes()
    if mode not in ("TRIANGLES", "INDICES") or stride not in (2, 4):
        raise GltfError(f"a view packed in the mode {str(mode)[:40]!r}")
    corners = (decode_triangles if mode == "TRIANGLES" else decode_indices)(data, count)
    return corners.astype(f"<u{stride}").tobytes()
