"""Meshes as binary glTF 2.0 (GLB): one file that Blender, three.js and every engine open."""

import struct
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float32, Float64, UInt8, UInt16

from goc.errors import FileError
from goc.files.atomic import write_bytes
from goc.scene import Mesh

_FLOAT, _USHORT, _UINT = 5126, 5123, 5125
_VERTICES, _CORNERS = 34962, 34963
_Y_UP_FROM_LEVEL = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""From z up to glTF's y up."""


def write_glb(
    path: Path,
    mesh: Mesh,
    normals: Float32[np.ndarray, "v 3"],
    level_from_world: Float64[np.ndarray, "4 4"],
    name: str,
) -> None:
    """Write a mesh as GLB, atomically: metres, y up, as glTF demands; vertex colours linear, as it demands too.

    Args:
        path: ends in .glb.
        mesh: world.
        normals: unit, world; tools shade smoothly by them.
        level_from_world: into the frame of exports (`World.level_from_world`): right-handed, z up, metres. A point
            (x, y, z) of that frame becomes (x, z, -y), so objects of one scene stay where they are to each other.
        name: what the object is called in the tools that open it.

    Raises:
        FileError: nothing to write, a position that is not finite (nothing is written), or the disk refuses.
    """
    if len(mesh.faces) == 0:
        raise FileError(f"{path}: the mesh has no faces, which glTF cannot say. Leave the file out.")
    if not np.isfinite(mesh.vertices).all():
        bad = ~np.isfinite(mesh.vertices).all(1)
        raise FileError(f"{path}: {bad.sum()} of {len(bad)} vertices are not finite. Repair the data.")
    matrix = _Y_UP_FROM_LEVEL @ level_from_world[:3]
    positions = (mesh.vertices.astype(np.float64) @ matrix[:, :3].T + matrix[:, 3]).astype(np.float32)
    turn = matrix[:, :3] / np.cbrt(np.linalg.det(matrix[:, :3]))
    turned = (normals.astype(np.float64) @ turn.T).astype(np.float32)
    turned[np.linalg.norm(turned, axis=1) < 0.5] = (0.0, 1.0, 0.0)  # unit vectors are demanded, surface or not
    parts: dict[str, np.ndarray] = {"POSITION": positions, "NORMAL": turned}
    if mesh.colours is not None:
        parts["COLOR_0"] = _linear(mesh.colours)
    write_bytes(path, _container(parts, mesh.faces.astype(np.uint32), name))


def _linear(colours: UInt8[np.ndarray, "v 3"]) -> UInt16[np.ndarray, "v 4"]:
    """SRGB bytes as linear 16 bits, opaque; four components keep every vertex on a multiple of four bytes."""
    value = np.arange(256) / 255.0
    table = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    linear = np.rint(table * 65535).astype(np.uint16)[colours]
    return np.concatenate([linear, np.full((len(linear), 1), 65535, np.uint16)], axis=1)


def _container(parts: dict[str, np.ndarray], faces: np.ndarray, name: str) -> bytes:
    arrays = [*parts.values(), faces.reshape(-1)]
    views, accessors, offset = [], [], 0
    for array in arrays:
        target = _CORNERS if array.ndim == 1 else _VERTICES
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": array.nbytes, "target": target})
        accessors.append(_accessor(array, len(accessors)))
        offset += array.nbytes
    low: Float32[np.ndarray, "3"] = parts["POSITION"].min(0)
    accessors[0] |= {"min": low.tolist(), "max": parts["POSITION"].max(0).tolist()}
    attributes = {key: place for place, key in enumerate(parts)}
    primitive = {"attributes": attributes, "indices": len(parts), "material": 0}
    material = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}}
    document = {
        "asset": {"version": "2.0", "generator": "goc"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"name": name, "primitives": [primitive]}],
        "materials": [material],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = msgspec.json.encode(document)
    text += b" " * (-len(text) % 4)
    body = b"".join(array.tobytes() for array in arrays)  # all of them are multiples of four bytes
    total = 12 + 8 + len(text) + 8 + len(body)
    header = struct.pack("<4sII", b"glTF", 2, total)
    return header + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body


def _accessor(array: np.ndarray, view: int) -> dict[str, Any]:
    kinds = {np.dtype(np.float32): _FLOAT, np.dtype(np.uint16): _USHORT, np.dtype(np.uint32): _UINT}
    shape = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
    entry = {"bufferView": view, "componentType": kinds[array.dtype], "count": len(array), "type": shape}
    return entry | ({"normalized": True} if array.dtype == np.uint16 else {})
