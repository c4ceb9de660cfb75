import numpy as np
import pytest

from goc.errors import ConfigError, FileError
from goc.files.any_mesh import MeshPiece, read_mesh_pieces
from goc.scene import Mesh
from goc.synth.assets import MeshFolder, draw_assets, list_meshes, make_asset, outward_faces
from goc.synth.model import mesh_of as model_mesh
from goc.synth.shapes import ball, cylinder, rounded_box
from meshfolder import chair, mesh_of, table, textured_box, write_folder
from oracles.watertight import trouble


def piece(solid):
    return (MeshPiece(mesh=mesh_of(solid)),)


def source(tmp_path, **settings):
    return MeshFolder(meshes=tmp_path, **settings)


def signed_volume(vertices, faces):
    a, b, c = (vertices[faces[:, i]].astype(float) for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_faces_are_turned_outwards_and_right_ones_stay():
    solid = ball(0.3, 12)
    vertices, faces = solid.vertices.astype(np.float32), solid.faces.astype(np.int32)
    np.testing.assert_array_equal(outward_faces(vertices, faces), faces)
    mixed = faces.copy()
    mixed[::2] = mixed[::2, ::-1]
    assert signed_volume(vertices, outward_faces(vertices, mixed)) == pytest.approx(signed_volume(vertices, faces))


def test_things_are_stood_upright_in_metres_with_their_back_behind(tmp_path):
    lying = chair().turned("x", -np.pi / 2)  # z up becomes y up
    scaled = Mesh(vertices=(100 * lying.vertices).astype(np.float32), faces=lying.faces.astype(np.int32))
    asset = make_asset((MeshPiece(mesh=scaled),), "chair", source(tmp_path, up="y", scale=0.01))
    low, high = asset.model.bounds
    np.testing.assert_allclose(low, [-0.21, -0.21, 0], atol=1e-5)
    np.testing.assert_allclose(high, [0.21, 0.21, 0.901], atol=1e-5)
    points = asset.model.parts[0].mesh.vertices
    assert asset.has_back and points[points[:, 2] > 0.8, 1].min() > 0.1
    assert asset.is_large and asset.is_support and asset.model.tops[0].z == pytest.approx(0.44, abs=0.004)


def test_long_sides_go_to_the_wall_where_there_is_no_back(tmp_path):
    asset = make_asset(piece(table(0.7, 1.1)), "table", source(tmp_path))
    assert not asset.has_back
    np.testing.assert_allclose(asset.size, [1.1, 0.7, 0.7], atol=1e-5)


def test_a_textured_thing_keeps_its_texture_and_is_written_welded(tmp_path):
    textured_box().export(tmp_path / "box.glb")
    asset = make_asset(read_mesh_pieces(tmp_path / "box.glb"), "box", source(tmp_path))
    item = asset.model.parts[0]
    look = item.material.appearance(np.array([[0.25, 0.75, 0.0]]))
    np.testing.assert_allclose(look.colour, [[0.85, 0, 0]], atol=1e-6)  # red, as bright as a surface can be
    mesh = model_mesh(asset.model)
    assert len(mesh.vertices) == 8 and trouble(mesh.vertices.astype(float), mesh.faces) == ""


@pytest.mark.parametrize(
    ("solid", "settings", "text"),
    [
        (ball(0.02, 12), {}, "0.04 m long, less than --min-m 0.06"),
        (rounded_box((3.0, 1.0, 1.0)), {}, "3 m long, more than --max-m 2.6"),
        (rounded_box((1.0, 1.0, 2.4)), {}, "2.40 m high"),
        (rounded_box((1.0, 1.0, 0.002)), {}, "flat"),
        (cylinder(0.05, 1.4), {}, "would topple"),
        (rounded_box((0.2, 0.2, 0.6)).turned("y", 0.7), {}, "stands on an edge|would topple"),
    ],
)
def test_what_cannot_stand_in_a_room_is_left_out(tmp_path, solid, settings, text):
    with pytest.raises(ValueError, match=text):
        make_asset(piece(solid), "thing", source(tmp_path, **settings))


def test_damaged_and_unsuitable_meshes_are_counted_and_named(tmp_path):
    heard = []
    folder = source(write_folder(tmp_path / "meshes"))
    names = {asset.model.name for asset in draw_assets(folder, np.random.default_rng(0), heard.append)}
    assert names == {"table", "low", "chair", "box", "parcel", "ball", *(f"block{index}" for index in range(5))}
    assert len(heard) == 2
    assert "1 of 14 meshes tried are damaged" in heard[0].message and "broken.glb: not a readable" in heard[0].message
    assert "2 of 14 meshes tried are unsuitable" in heard[1].message


def test_objects_csv_gives_names_and_splits(tmp_path):
    folder = write_folder(tmp_path / "meshes")
    (folder / "objects.csv").write_text("file,name,split\ntable.ply,Oak table,val\ndeep/box.glb,Crate,train\n")
    assert [name for _, name in list_meshes(source(folder, split="val"))] == ["Oak table"]
    assert "Crate" in [name for _, name in list_meshes(source(folder / "deep"))]
    with pytest.raises(ConfigError, match="--split test: no mesh .* knows train, val"):
        list_meshes(source(folder, split="test"))
    (folder / "objects.csv").write_text("file,name\n")
    with pytest.raises(FileError, match="has no column split"):
        list_meshes(source(folder))


def test_folders_of_no_use_are_refused(tmp_path):
    with pytest.raises(FileError, match="holds no meshes"):
        list_meshes(source(tmp_path))
    with pytest.raises(FileError, match="not a folder"):
        list_meshes(source(tmp_path / "none"))
    with pytest.raises(ConfigError, match="MeshFolder.scale is 0: needs more than 0"):
        source(tmp_path, scale=0.0)


def test_a_face_without_area_does_no_harm(tmp_path):
    (solid,) = piece(rounded_box((0.5, 0.4, 0.3)))
    corners = np.concatenate([solid.mesh.faces, [[0, 1, 1], [0, 0, 0]]]).astype(np.int32)
    flat = MeshPiece(mesh=Mesh(vertices=solid.mesh.vertices, faces=corners))
    asset = make_asset((flat,), "box", source(tmp_path))
    assert all(np.isfinite(part.mesh.vertices).all() for part in asset.model.parts)
    assert len(asset.model.tops) == len(make_asset((solid,), "box", source(tmp_path)).model.tops)
