import numpy as np
import pytest
import trimesh
from PIL import Image

from goc.errors import FileError
from goc.files import read_any_mesh, read_mesh, welded, write_mesh
from goc.files.any_mesh import read_mesh_pieces, sample_texture
from goc.files.colour import decode_srgb, encode_srgb
from goc.scene import Mesh
from goc.synth.shapes import rounded_box
from meshfolder import TEXTURE, mesh_of, textured_box
from oracles.watertight import trouble


@pytest.fixture(params=["box.glb", "box.obj"])
def textured(request, tmp_path):
    """The textured box in a format that has textures."""
    textured_box().export(tmp_path / request.param)
    return tmp_path / request.param


def test_a_ply_is_read_as_ever(tmp_path):
    mesh = mesh_of(rounded_box((1.0, 2.0, 3.0)))
    write_mesh(tmp_path / "box.ply", mesh)
    again, plain = read_any_mesh(tmp_path / "box.ply"), read_mesh(tmp_path / "box.ply")
    np.testing.assert_array_equal(again.vertices, plain.vertices)
    np.testing.assert_array_equal(again.colours, mesh.colours)


def test_textures_are_kept_and_their_colours_come_to_the_vertices(textured):
    (piece,) = read_mesh_pieces(textured)
    np.testing.assert_array_equal(piece.texture, TEXTURE)
    mesh = read_any_mesh(textured)
    np.testing.assert_allclose(mesh.vertices.min(0), [-0.1, -0.08, 0], atol=1e-6)
    np.testing.assert_allclose(mesh.vertices.max(0), [0.1, 0.08, 0.12], atol=1e-6)
    # The corners lie where the texture begins again: each is the mean of all four texels.
    np.testing.assert_array_equal(
        mesh.colours, np.broadcast_to(encode_srgb(decode_srgb(TEXTURE).mean((0, 1))), (36, 3))
    )


def test_welding_closes_what_seams_had_opened(textured):
    mesh = read_any_mesh(textured, weld=True)
    assert len(mesh.vertices) == 8 and len(mesh.faces) == 12
    assert trouble(mesh.vertices.astype(float), mesh.faces) == ""


def test_welding_drops_faces_that_collapse():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]], np.float32)
    mesh = welded(Mesh(vertices=vertices, faces=np.array([[0, 1, 2], [1, 3, 2]], np.int32)))
    assert len(mesh.vertices) == 3 and len(mesh.faces) == 1


def test_texture_samples_are_exact_at_texels_linear_between_and_repeat():
    light = decode_srgb(TEXTURE)
    uv = np.array([[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]])
    np.testing.assert_allclose(sample_texture(TEXTURE, uv), light.reshape(4, 3), atol=1e-6)
    np.testing.assert_allclose(sample_texture(TEXTURE, uv + np.array([3.0, -2.0])), light.reshape(4, 3), atol=1e-6)
    between = sample_texture(TEXTURE, np.array([[0.5, 0.75], [0.375, 0.5]]))
    np.testing.assert_allclose(between[0], light[0].mean(0), atol=1e-6)
    np.testing.assert_allclose(between[1], (0.75 * light[:, 0] + 0.25 * light[:, 1]).mean(0), atol=1e-6)


def test_parts_of_a_scene_are_placed_and_mirrored_ones_stay_outside_out(tmp_path):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    scene = trimesh.Scene()
    scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([5, 0, 0]), geom_name="one")
    scene.add_geometry(box, transform=np.diag([-1.0, 1.0, 1.0, 1.0]), geom_name="two")
    scene.export(tmp_path / "two.glb")
    mesh = read_any_mesh(tmp_path / "two.glb", weld=True)
    assert len(mesh.vertices) == 16 and mesh.vertices[:, 0].max() == pytest.approx(5.5)
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(2.0)  # the volume, positive


def test_a_material_of_one_colour_colours_the_vertices(tmp_path):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    box.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[0.5, 0.25, 0.0, 1.0])
    )
    box.export(tmp_path / "box.glb")
    colours = read_any_mesh(tmp_path / "box.glb").colours
    np.testing.assert_allclose(decode_srgb(colours)[0], [0.5, 0.25, 0.0], atol=0.01)


def test_vertex_colours_come_as_they_are_and_no_colours_as_none(tmp_path):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    box.export(tmp_path / "plain.glb")
    box.visual = trimesh.visual.ColorVisuals(box, vertex_colors=np.tile([10, 200, 30, 255], (8, 1)).astype(np.uint8))
    box.export(tmp_path / "green.glb")
    assert (read_any_mesh(tmp_path / "green.glb").colours == [10, 200, 30]).all()
    assert read_any_mesh(tmp_path / "plain.glb").colours is None


def test_an_obj_reads_nothing_outside_its_folder(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    Image.new("RGB", (4, 4), (250, 0, 0)).save(tmp_path / "secret.png")
    (inside / "a.mtl").write_text("newmtl m\nmap_Kd ../secret.png\n")
    (inside / "a.obj").write_text(
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    (piece,) = read_mesh_pieces(inside / "a.obj")
    assert piece.texture is None


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.glb", b"glTF, but not really", "not a readable GLB file"),
        ("a.glb", b"", "not a readable GLB file"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "holds no faces|not a readable OBJ"),
        ("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "1 of 3 vertices are not finite"),
        ("a.stl", b"solid", "holds no faces"),
        ("a.stp", b"solid", "not a mesh that goc reads. Convert it to one of .glb, .gltf, .obj"),
        ("a.ply", b"ply", "a.ply"),
    ],
)
def test_files_of_no_use_are_refused(tmp_path, name, content, text):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError, match=text):
        read_any_mesh(tmp_path / name)
    with pytest.raises(FileError, match="not found"):
        read_any_mesh(tmp_path / "none.glb")
