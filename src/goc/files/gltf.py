"""Rewrites any glTF file as a plain GLB: dense float arrays, nothing quantised, sparse, compressed or elsewhere.

What is left is what every reader understands; positions, texture coordinates, colours, faces and materials.
"""

import struct
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float32, Shaped

from goc.files.gltf_arrays import DRACO, Accessors, unpack_draco
from goc.files.gltf_buffers import MESHOPT, Gltf, GltfError, parse_gltf

_POINTS, _LINES, _TRIANGLES, _STRIP, _FAN = 0, (1, 2, 3), 4, 5, 6
_UNDERSTOOD = (MESHOPT, DRACO, "KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp", "KHR_node_visibility")
_INSTANCES = "EXT_mesh_gpu_instancing"
_TRANSFORM = "KHR_texture_transform"


def plain_glb(path: Path, data: bytes) -> bytes:
    """The same scene as a GLB without extensions of geometry; buffers and images of a .gltf are put in.

    Args:
        path: where the file lies: what it names has to lie in its folder, or below.
        data: its bytes.

    Raises:
        GltfError: damaged, larger than a file of its size may unpack to, or of an extension that is not understood.
        FileError: Draco is not installed, or a file beside it cannot be read.
    """
    gltf = parse_gltf(path, data)
    _check_extensions(gltf)
    writer = _Writer()
    accessors = Accessors(gltf)
    meshes = []
    for mesh in gltf.entries("meshes"):
        primitives = [_primitive(gltf, accessors, entry, writer) for entry in mesh.get("primitives", [])]
        meshes.append({"name": str(mesh.get("name", "mesh")), "primitives": [one for one in primitives if one]})
    kept = {name: gltf.document[name] for name in ("scene", "scenes", "materials", "textures") if name in gltf.document}
    nodes = [
        {key: node[key] for key in ("name", "children", "mesh", "matrix", "translation", "rotation", "scale")
         if key in node} for node in gltf.entries("nodes")
    ]  # fmt: skip
    images = [_image(gltf, entry, writer) for entry in gltf.entries("images")]
    document = {**kept, "asset": {"version": "2.0"}, "nodes": nodes, "meshes": meshes, "images": images}
    return writer.glb({name: value for name, value in document.items() if value or name == "scene"})


def _check_extensions(gltf: Gltf) -> None:
    required, used = (gltf.document.get(name, []) for name in ("extensionsRequired", "extensionsUsed"))
    unknown = [
        str(name)[:60] for name in required if name not in _UNDERSTOOD and not str(name).startswith(_HARMLESS)
    ] + [_INSTANCES] * (_INSTANCES in used and _INSTANCES not in required)
    if unknown:
        raise GltfError(f"It needs the glTF extension {unknown[0]}, which goc does not read. Export it without.")


def _primitive(gltf: Gltf, accessors: Accessors, entry: dict[str, Any], writer: "_Writer") -> dict[str, Any] | None:
    """Positions, texture coordinates, colours and corners, written anew; None for lines."""
    mode, attributes = entry.get("mode", _TRIANGLES), entry.get("attributes", {})
    if mode in _LINES or "POSITION" not in attributes:
        return None
    packed = unpack_draco(gltf, accessors, entry) if DRACO in entry.get("extensions", {}) else {}

    def read(name: str) -> Float32[np.ndarray, "n w"]:
        return packed[name] if name in packed else accessors.values(attributes[name])

    positions = read("POSITION")
    if positions.shape[1] != 3:
        raise GltfError(f"positions of {positions.shape[1]} numbers")
    made: dict[str, Any] = {"attributes": {"POSITION": writer.add(positions)}}
    texture = _base_texture(gltf, entry.get("material"))
    transform = (texture or {}).get("extensions", {}).get(_TRANSFORM, {})
    name = f"TEXCOORD_{transform.get('texCoord', (texture or {}).get('texCoord', 0))}"
    if name in attributes:
        places = _transformed(read(name)[:, :2], transform)
        made["attributes"]["TEXCOORD_0"] = writer.add(places.astype(np.float32))
    if "COLOR_0" in attributes:
        colours = np.nan_to_num(read("COLOR_0"))[:, :4]
        made["attributes"]["COLOR_0"] = writer.add(np.rint(np.clip(colours, 0, 1) * 255).astype(np.uint8))
    if mode != _POINTS:
        corners = packed.get("indices")
        if corners is None and "indices" in entry:
            corners = accessors.numbers(entry["indices"])
        corners = np.arange(len(positions)) if corners is None else corners[:, 0].astype(np.int64)
        made["indices"] = writer.add(_faces(corners, mode).astype(np.uint32).reshape(-1, 1))
    if "material" in entry:
        gltf.entry("materials", entry["material"])
        made["material"] = entry["material"]
    return made | {"mode": _POINTS if mode == _POINTS else _TRIANGLES}


def _faces(corners: Shaped[np.ndarray, "n"], mode: int) -> Shaped[np.ndarray, "t 3"]:
    if mode == _TRIANGLES:
        if len(corners) % 3:
            raise GltfError(f"triangles of {len(corners)} corners")
        return corners.reshape(-1, 3)
    if mode not in (_STRIP, _FAN):
        raise GltfError(f"primitives of mode {str(mode)[:20]!r}")
    count = max(len(corners) - 2, 0)
    if mode == _FAN:
        return np.stack([np.full(count, corners[0] if count else 0), corners[1 : count + 1], corners[2:]], -1)
    found = np.stack([corners[:count], corners[1 : count + 1], corners[2:]], -1)
    found[1::2] = found[1::2, [1, 0, 2]]
    return found


def _base_texture(gltf: Gltf, material: object) -> dict[str, Any] | None:
    if material is None:
        return None
    entry = gltf.entry("materials", material)
    found = entry.get("pbrMetallicRoughness", {}).get("baseColorTexture")
    old = entry.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {}).get("diffuseTexture")
    return found or old


def _transformed(places: Float32[np.ndarray, "n 2"], transform: dict[str, Any]) -> Shaped[np.ndarray, "n 2"]:
    """Texture coordinates by KHR_texture_transform: scaled, turned, moved."""
    if not transform:
        return places
    scale, move = np.array(transform.get("scale", (1, 1)), float), np.array(transform.get("offset", (0, 0)), float)
    c, s = np.cos(transform.get("rotation", 0.0)), np.sin(transform.get("rotation", 0.0))
    return (places * scale) @ np.array([[c, -s], [s, c]]) + move


def _image(gltf: Gltf, entry: dict[str, Any], writer: "_Writer") -> dict[str, Any]:
    data = gltf.view(entry["bufferView"])[0] if "bufferView" in entry else gltf.resource(entry.get("uri"))
    return {"bufferView": writer.view(data), "mimeType": str(entry.get("mimeType", "image/png"))}


class _Writer:
    """Collects arrays into one buffer."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0
        self._views: list[dict[str, int]] = []
        self._accessors: list[dict[str, Any]] = []

    def view(self, data: bytes) -> int:
        """Append bytes, and pad them to a multiple of four."""
        self._views.append({"buffer": 0, "byteOffset": self._size, "byteLength": len(data)})
        self._parts += [data, b"\0" * (-len(data) % 4)]
        self._size += len(data) + -len(data) % 4
        return len(self._views) - 1

    def add(self, array: Shaped[np.ndarray, "n w"]) -> int:
        """Append an array; returns its accessor."""
        kind = {"f4": 5126, "u4": 5125, "u1": 5121}[array.dtype.str[1:]]
        shape = ("SCALAR", "VEC2", "VEC3", "VEC4")[array.shape[1] - 1]
        view = self.view(np.ascontiguousarray(array).tobytes())
        entry = {"bufferView": view, "componentType": kind, "count": len(array), "type": shape}
        self._accessors.append(entry | ({"normalized": True} if kind == 5121 else {}))
        return len(self._accessors) - 1

    def glb(self, document: dict[str, Any]) -> bytes:
        """The file."""
        own = {"buffers": [{"byteLength": self._size}], "bufferViews": self._views, "accessors": self._accessors}
        text = msgspec.json.encode(document | own)
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + self._size)
        chunk = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", self._size, b"BIN\0")
        return b"".join([head, chunk, *self._parts])
