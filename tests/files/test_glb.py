"""GLB by its specification: metres, y up, linear colours, everything aligned."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from assets import box_mesh
from goc.errors import FileError
from goc.files import write_glb
from goc.geometry.surfaces import vertex_normals
from goc.scene import World

BOX = np.array([[1.0, 2.0, 0.0], [2.0, 4.0, 5.0]])


def parsed(path):
    data = path.read_bytes()
    magic, version, total, length, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, total, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20 : 20 + length])
    size, kind = struct.unpack("<I4s", data[20 + length : 28 + length])
    body = data[28 + length :]
    assert kind == b"BIN\0" and size == len(body) == document["buffers"][0]["byteLength"]
    assert length % 4 == 0 and size % 4 == 0
    return document, body


def array(document, body, index):
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    assert view["byteOffset"] % 4 == 0
    kind = {5126: np.float32, 5123: np.uint16, 5125: np.uint32}[accessor["componentType"]]
    flat = np.frombuffer(body[view["byteOffset"] :][: view["byteLength"]], kind)
    return flat.reshape(accessor["count"], -1)


def level(up=(0.0, 0.0, 1.0), units_per_metre=1.0, floor=0.0):
    up = np.array(up, float)
    world = World(up=up, floor=floor, confidence=1.0, units_per_metre=units_per_metre, metric=True)
    return world.level_from_world


def written(path, mesh, **world):
    write_glb(path, mesh, vertex_normals(mesh), level(**world), "box")
    document, body = parsed(path)
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    return document, {name: array(document, body, index) for name, index in attributes.items()}, body


def test_z_up_becomes_y_up_in_metres(tmp_path):
    mesh = box_mesh(BOX)
    document, parts, body = written(tmp_path / "box.glb", mesh, units_per_metre=2.0)
    x, y, z = mesh.vertices.T / 2
    np.testing.assert_allclose(parts["POSITION"], np.stack([x, z, -y], 1), atol=1e-6)
    accessor = document["accessors"][0]
    np.testing.assert_allclose([accessor["min"], accessor["max"]], [[0.5, 0, -2], [1, 2.5, -1]])
    faces = array(document, body, document["meshes"][0]["primitives"][0]["indices"]).reshape(-1, 3)
    a, b, c = parts["POSITION"].astype(float)[faces].transpose(1, 0, 2)
    assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(10 / 8)  # still outwards
    np.testing.assert_allclose(np.linalg.norm(parts["NORMAL"], axis=1), 1, atol=1e-6)
    assert document["nodes"][0]["name"] == "box"


def test_any_up_becomes_y(tmp_path):
    up = np.array([1.0, -2.0, 2.0]) / 3
    mesh = box_mesh(BOX)
    _, parts, _ = written(tmp_path / "box.glb", mesh, up=up, units_per_metre=4.0, floor=0.5)
    np.testing.assert_allclose(parts["POSITION"][:, 1], (mesh.vertices @ up - 0.5) / 4, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(parts["NORMAL"], axis=1), 1, atol=1e-6)
    apart = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices, axis=-1)
    moved = np.linalg.norm(parts["POSITION"][:, None] - parts["POSITION"], axis=-1)
    np.testing.assert_allclose(moved, apart / 4, atol=1e-5)


def test_what_is_y_up_stays_as_it_is(tmp_path):
    mesh = box_mesh(BOX)
    _, parts, _ = written(tmp_path / "box.glb", mesh, up=(0.0, 1.0, 0.0))
    np.testing.assert_allclose(parts["POSITION"], mesh.vertices, atol=1e-6)


def test_colours_are_linear(tmp_path):
    _, parts, _ = written(tmp_path / "box.glb", box_mesh(BOX, (0, 188, 255)))
    np.testing.assert_allclose(parts["COLOR_0"][0] / 65535, [0, 0.5029, 1, 1], atol=1e-4)
    _, parts, _ = written(tmp_path / "plain.glb", replace(box_mesh(BOX), colours=None))
    assert sorted(parts) == ["NORMAL", "POSITION"]


def test_what_gltf_cannot_say_is_refused(tmp_path):
    mesh = box_mesh(BOX)
    with pytest.raises(FileError, match="the mesh has no faces, which glTF cannot say"):
        written(tmp_path / "a.glb", replace(mesh, faces=mesh.faces[:0]))
    broken = mesh.vertices.copy()
    broken[3] = np.nan
    with pytest.raises(FileError, match=r"a\.glb: 1 of 8 vertices are not finite"):
        write_glb(tmp_path / "a.glb", replace(mesh, vertices=broken), mesh.vertices, level(), "box")
    assert list(tmp_path.iterdir()) == []
