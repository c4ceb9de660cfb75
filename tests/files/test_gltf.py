"""glTF in every coding: each says the same shape, and none more than its bytes can bear."""

import base64
import json
import struct

import numpy as np
import pytest
from PIL import Image

from fuzz import assert_only_file_errors
from goc.errors import FileError
from goc.files import read_any_mesh
from goc.files.any_mesh import read_mesh_pieces
from goc.files.meshopt import decode_attributes, decode_indices, decode_triangles, undo_exponents
from oracles.meshopt import encoded_attributes, encoded_triangles

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-0.5, 0.5) for z in (0, 2)], np.float32)
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]], np.uint16,
)  # fmt: skip


class Maker:
    """A glTF document and its buffer, put together by hand."""

    def __init__(self, **document):
        self.views, self.body = [], b""
        self.document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
        self.document |= {"accessors": [], **document}

    def view(self, data, **extra):
        self.views.append({"buffer": 0, "byteOffset": len(self.body), "byteLength": len(data), **extra})
        self.body += bytes(data) + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def accessor(self, **entry):
        self.document["accessors"].append(entry)
        return len(self.document["accessors"]) - 1

    def mesh(self, positions, indices=None, **primitive):
        attributes = {"POSITION": positions, **primitive.pop("attributes", {})}
        primitive = {"attributes": attributes, **primitive} | ({} if indices is None else {"indices": indices})
        self.document["meshes"] = [{"primitives": [primitive]}]
        return self

    def plain(self):
        positions = self.accessor(bufferView=self.view(CORNERS.tobytes()), componentType=5126, count=8, type="VEC3")
        corners = self.view(FACES.tobytes())
        return self.mesh(positions, self.accessor(bufferView=corners, componentType=5123, count=36, type="SCALAR"))

    def glb(self, path):
        own = {"bufferViews": self.views, "buffers": [{"byteLength": len(self.body)}]}
        text = json.dumps(own | self.document).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self.body))
        path.write_bytes(
            head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.body), b"BIN\0")
            + self.body
        )  # fmt: skip
        return path


def quantized(maker):
    """Positions as normalised shorts, put to their size by the node (KHR_mesh_quantization)."""
    stored = np.zeros((8, 4), np.int16)
    stored[:, :3] = np.rint((CORNERS - [0, 0, 1]) * 32767)
    maker.document |= {
        "extensionsRequired": ["KHR_mesh_quantization"],
        "nodes": [{"mesh": 0, "translation": [0, 0, 1]}],
    }
    view = maker.view(stored.tobytes(), byteStride=8)
    return maker.accessor(bufferView=view, componentType=5122, count=8, type="VEC3", normalized=True)


def sparse(maker):
    """The upper corners are put in by a sparse accessor."""
    low = CORNERS * [1, 1, 0]
    rows = np.flatnonzero(CORNERS[:, 2] > 0).astype(np.uint8)
    what = {
        "count": len(rows),
        "indices": {"bufferView": maker.view(rows.tobytes()), "componentType": 5121},
        "values": {"bufferView": maker.view(CORNERS[rows].tobytes())},
    }
    view = maker.view(low.astype(np.float32).tobytes())
    return maker.accessor(bufferView=view, componentType=5126, count=8, type="VEC3", sparse=what)


def meshopt(maker):
    """Positions and corners in two compressed views."""
    maker.document["extensionsRequired"] = ["EXT_meshopt_compression"]
    stored = encoded_attributes(CORNERS.view(np.uint8).reshape(8, 12))
    packed = {
        "buffer": 0,
        "byteOffset": 0,
        "byteLength": len(stored),
        "mode": "ATTRIBUTES",
        "byteStride": 12,
        "count": 8,
    }
    maker.body += stored + b"\0" * (-len(stored) % 4)
    maker.views.append({"buffer": 1, "byteLength": 96, "extensions": {"EXT_meshopt_compression": packed}})
    return maker.accessor(bufferView=0, componentType=5126, count=8, type="VEC3")


@pytest.mark.parametrize("coding", [quantized, sparse, meshopt])
def test_every_coding_of_positions_says_the_same(tmp_path, coding):
    maker = Maker()
    positions = coding(maker)
    corners = maker.accessor(bufferView=maker.view(FACES.tobytes()), componentType=5123, count=36, type="SCALAR")
    mesh = read_any_mesh(maker.mesh(positions, corners).glb(tmp_path / "box.glb"))
    np.testing.assert_allclose(mesh.vertices, CORNERS, atol=1e-4)
    np.testing.assert_array_equal(mesh.faces, FACES)


def test_draco_is_decoded(tmp_path):
    DracoPy = pytest.importorskip("DracoPy", reason="goc[formats] is not installed")
    maker = Maker(extensionsRequired=["KHR_draco_mesh_compression"])
    view = maker.view(DracoPy.encode(CORNERS, FACES.astype(np.uint32), quantization_bits=14, preserve_order=True))
    positions = maker.accessor(componentType=5126, count=8, type="VEC3")
    corners = maker.accessor(componentType=5123, count=36, type="SCALAR")
    packed = {"bufferView": view, "attributes": {"POSITION": 0}}
    path = maker.mesh(positions, corners, extensions={"KHR_draco_mesh_compression": packed}).glb(tmp_path / "d.glb")
    mesh = read_any_mesh(path, weld=True)
    assert len(mesh.vertices) == 8 and len(mesh.faces) == 12
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [2, 1, 2], atol=1e-3)


def test_without_the_extra_draco_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "DracoPy", None)
    maker = Maker()
    view, positions = maker.view(b"DRACO"), maker.accessor(componentType=5126, count=8, type="VEC3")
    packed = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {"POSITION": 0}}}
    with pytest.raises(
        FileError, match=r"d\.glb: its meshes are compressed by Draco\. Run `pip install goc\[formats\]`"
    ):
        read_any_mesh(maker.mesh(positions, extensions=packed).glb(tmp_path / "d.glb"))


def test_buffers_and_images_beside_a_gltf_are_read_and_none_from_elsewhere(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    Image.new("RGB", (2, 2), (250, 0, 0)).save(inside / "red.png")
    maker = Maker(images=[{"uri": "red.png"}], textures=[{"source": 0}])
    maker.document["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    maker.plain()
    uv = maker.accessor(
        bufferView=maker.view(np.zeros((8, 2), "f4").tobytes()), componentType=5126, count=8, type="VEC2"
    )
    maker.document["meshes"][0]["primitives"][0] |= {"material": 0}
    maker.document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv
    (inside / "box.bin").write_bytes(maker.body)
    (tmp_path / "far.bin").write_bytes(maker.body)
    text = "data:application/octet-stream;base64," + base64.b64encode(maker.body).decode()
    for uri, good in ((text, True), ("box.bin", True), ("../far.bin", False), ("http://localhost/box.bin", False)):
        buffers = [{"uri": uri, "byteLength": len(maker.body)}]
        (inside / "box.gltf").write_text(json.dumps(maker.document | {"bufferViews": maker.views, "buffers": buffers}))
        if good:
            mesh = read_any_mesh(inside / "box.gltf", weld=True)
            assert len(mesh.vertices) == 8 and (mesh.colours == [250, 0, 0]).all()
        else:
            with pytest.raises(FileError, match=r"box\.gltf: It names a file outside its own folder\. Put all"):
                read_any_mesh(inside / "box.gltf")
    (inside / "box.bin").unlink()
    (inside / "box.gltf").write_text(
        json.dumps(maker.document | {"bufferViews": maker.views, "buffers": [{"uri": "box.bin", "byteLength": 4}]})
    )
    with pytest.raises(FileError, match=r"Its file 'box\.bin' is missing\. Put it beside this one, or export a \.glb"):
        read_any_mesh(inside / "box.gltf")


def test_quantised_texture_coordinates_are_scaled_by_their_material(tmp_path):
    """KHR_texture_transform is how tools undo the quantisation of texture coordinates."""
    maker = Maker(textures=[{"source": 0}])
    image = maker.view((lambda path: (Image.new("RGB", (2, 2)).save(path), path.read_bytes())[1])(tmp_path / "i.png"))
    maker.document["images"] = [{"bufferView": image, "mimeType": "image/png"}]
    transform = {"KHR_texture_transform": {"offset": [0.25, 0.5], "scale": [0.5, 0.25], "rotation": np.pi / 2}}
    texture = {"index": 0, "extensions": transform}
    maker.document["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": texture}}]
    maker.plain()
    view = maker.view(np.tile(np.array([65535, 0], np.uint16), (8, 1)).tobytes())
    uv = maker.accessor(bufferView=view, componentType=5123, count=8, type="VEC2", normalized=True)
    maker.document["meshes"][0]["primitives"][0] |= {"material": 0}
    maker.document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv
    (piece,) = read_mesh_pieces(maker.glb(tmp_path / "t.glb"))
    np.testing.assert_allclose(piece.uv, np.tile([0.25, 1 - (0.5 - 0.5)], (8, 1)), atol=1e-4)  # v is stored upside down


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"extensionsRequired": ["EXT_cloud_magic"]},
            "the glTF extension EXT_cloud_magic, which goc does not read",
        ),
        ({"extensionsUsed": ["EXT_mesh_gpu_instancing"]}, "needs the glTF extension EXT_mesh_gpu_instancing"),
        ({"asset": {"version": "1.0"}}, "not of version 2 of glTF"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 99}}]}]}, "names 99 of its 2 accessors"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, change, words):
    maker = Maker().plain()
    maker.document |= change
    with pytest.raises(FileError, match=words):
        read_any_mesh(maker.glb(tmp_path / "box.glb"))


def test_small_files_do_not_unpack_to_gigabytes(tmp_path):
    count = 365_000_000
    bombs = {
        "zeros": {"count": count, "sparse": {"count": 0, "indices": {"bufferView": 0}, "values": {"bufferView": 0}}},
        "none": {"count": count},
        "view": {"count": count, "bufferView": 0},
    }
    for name, entry in bombs.items():
        maker = Maker().plain()
        maker.document["accessors"][0] |= {"componentType": 5126, "type": "VEC3"} | entry
        if name != "view":
            del maker.document["accessors"][0]["bufferView"]
        path = maker.glb(tmp_path / f"{name}.glb")
        with pytest.raises(FileError, match=r"take more than 67,108,864 bytes, out of a much smaller file"):
            read_any_mesh(path)
    maker = Maker(extensionsRequired=["EXT_meshopt_compression"]).plain()
    packed = {"buffer": 0, "byteLength": 40, "mode": "ATTRIBUTES", "byteStride": 12, "count": count}
    maker.views[0] |= {"extensions": {"EXT_meshopt_compression": packed}}
    with pytest.raises(FileError, match="a compressed view of 4,380,000,000 bytes in a much smaller file"):
        read_any_mesh(maker.glb(tmp_path / "packed.glb"))


def test_a_large_texture_is_refused_before_it_is_decoded(tmp_path):
    maker = Maker(textures=[{"source": 0}])
    Image.new("1", (13_000, 13_000)).save(tmp_path / "large.png")
    maker.document["images"] = [{"bufferView": maker.view((tmp_path / "large.png").read_bytes())}]
    maker.document["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    maker.plain()
    view = maker.view(np.zeros((8, 2), "f4").tobytes())
    uv = maker.accessor(bufferView=view, componentType=5126, count=8, type="VEC2")
    maker.document["meshes"][0]["primitives"][0] |= {"material": 0}
    maker.document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv
    with pytest.raises(FileError, match="its texture has 13000 x 13000 pixels, more than 89 million"):
        read_mesh_pieces(maker.glb(tmp_path / "large.glb"))


def test_strips_fans_and_points_are_understood(tmp_path):
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
    for mode, faces in ((5, [[0, 1, 2], [2, 1, 3]]), (6, [[0, 1, 2], [0, 2, 3]])):
        maker = Maker()
        positions = maker.accessor(bufferView=maker.view(square.tobytes()), componentType=5126, count=4, type="VEC3")
        mesh = read_any_mesh(maker.mesh(positions, mode=mode).glb(tmp_path / "s.glb"))
        assert mesh.faces.tolist() == faces


def test_damaged_gltf_ends_in_one_line(tmp_path):
    for coding in (sparse, meshopt, quantized):
        maker = Maker()
        positions = coding(maker)
        corners = maker.accessor(bufferView=maker.view(FACES.tobytes()), componentType=5123, count=36, type="SCALAR")
        assert_only_file_errors(read_any_mesh, maker.mesh(positions, corners).glb(tmp_path / "box.glb"), 120)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 255, 700])
@pytest.mark.parametrize("stride", [4, 12, 64])
def test_compressed_rows_come_back(count, stride):
    random = np.random.default_rng(count * stride)
    rows = np.cumsum(random.integers(-3, 4, (count, stride)), axis=0).astype(np.uint8)
    rows[:, 0] = 7
    rows[:, 1] = random.integers(0, 256, count)
    data = encoded_attributes(rows)
    np.testing.assert_array_equal(decode_attributes(data, count, stride), rows)
    for damaged in (data[:-1], data[:20], b"\xa1" + data[1:], data + b"\0"):
        with pytest.raises(ValueError, match="meshopt|cut short|does not end"):
            decode_attributes(damaged, count, stride)


def test_compressed_triangles_come_back():
    random = np.random.default_rng(0)
    rows, columns = 40, 30
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    grid = np.concatenate(
        [np.stack([a, a + 1, a + columns + 1], -1), np.stack([a + 1, a + columns + 2, a + columns + 1], -1)]
    )
    for faces in (grid, grid[random.permutation(len(grid))], random.integers(0, 5000, (300, 3))):
        data = encoded_triangles(faces)
        np.testing.assert_array_equal(decode_triangles(data, faces.size).reshape(-1, 3), faces)
    with pytest.raises(ValueError, match="cut short"):
        decode_triangles(data[:60], faces.size)


def test_index_sequences_and_exponents_by_hand():
    data = bytes(
        [0xD1, 0b0000_1000, 0b0000_0100, 0b0000_0110, 0b0001_0001, 0, 0, 0, 0]
    )  # +2, +1, -2: the sequence is one
    assert decode_indices(data, 3).tolist() == [2, 3, 1]
    words = np.array([[5 | (-2 & 255) << 24, (1 << 24) - 3]], np.uint32).view(np.uint8)
    assert undo_exponents(words).view("<f4").tolist() == [[1.25, -3.0]]
