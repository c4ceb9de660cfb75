import struct

import numpy as np
import pytest

from fuzz import assert_only_file_errors
from goc.errors import FileError
from goc.files import read_mesh, read_observed_mesh, read_points, write_mesh, write_points
from goc.scene import Mesh, PointCloud

TETRAHEDRON = Mesh(
    vertices=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32),
    faces=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32),
    colours=np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 8, 7]], np.uint8),
)
OBSERVED = np.array([True, False, True, True])
HEAD = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
SQUARE = (
    HEAD.format(4) + "element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
)


def written(tmp_path, text):
    path = tmp_path / "file.ply"
    path.write_text(text)
    return path


def test_a_mesh_comes_back_bit_equal(tmp_path):
    write_mesh(tmp_path / "m.ply", TETRAHEDRON, OBSERVED)
    mesh, observed = read_observed_mesh(tmp_path / "m.ply")
    np.testing.assert_array_equal(mesh.vertices, TETRAHEDRON.vertices)
    np.testing.assert_array_equal(mesh.faces, TETRAHEDRON.faces)
    np.testing.assert_array_equal(mesh.colours, TETRAHEDRON.colours)
    np.testing.assert_array_equal(observed, OBSERVED)


def test_the_bytes_are_those_of_the_format(tmp_path):
    """Written out by hand: what any other reader of PLY expects."""
    write_mesh(tmp_path / "m.ply", TETRAHEDRON, OBSERVED)
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 4\n"
    header += "".join(f"property float {name}\n" for name in "xyz")
    header += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "observed"))
    header += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    rows = zip(TETRAHEDRON.vertices, TETRAHEDRON.colours, OBSERVED, strict=True)
    body = b"".join(struct.pack("<3f4B", *position, *colour, int(flag)) for position, colour, flag in rows)
    body += b"".join(struct.pack("<B3i", 3, *face) for face in TETRAHEDRON.faces)
    assert (tmp_path / "m.ply").read_bytes() == header.encode() + body


def test_polygons_become_fans(tmp_path):
    assert read_mesh(written(tmp_path, SQUARE + "4 0 1 2 3\n")).faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    mixed = SQUARE.replace("face 1", "face 3") + "3 0 1 2\n4 1 2 3 0\n3 3 2 1\n"
    assert read_mesh(written(tmp_path, mixed)).faces.tolist() == [[0, 1, 2], [1, 2, 3], [1, 3, 0], [3, 2, 1]]


def test_a_mesh_without_flags_has_no_observed(tmp_path):
    write_mesh(tmp_path / "m.ply", TETRAHEDRON)
    with pytest.raises(FileError, match=r"m\.ply: its vertices have no property observed"):
        read_observed_mesh(tmp_path / "m.ply")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SQUARE + "3 0 1 4\n", r"1 corners name a vertex that is not there \(first: 4 of 4\)"),
        (SQUARE + "3 0 -1 2\n", r"1 corners name a vertex that is not there \(first: -1 of 4\)"),
        (SQUARE + "2 0 1\n", r"1 faces have fewer than three corners \(first: face 0\)"),
        (SQUARE.replace("1 1 0", "1 nan 0") + "3 0 1 2\n", r"1 of 4 vertices are not finite \(first: 2\)"),
        (SQUARE.replace("1 1 0", "1e39 1 0") + "3 0 1 2\n", "1 of 4 vertices are not finite"),
        (SQUARE.replace("int vertex_index", "float vertex_index") + "3 0 1 2\n", "holds no faces"),
        (SQUARE.replace("face 1", "face 0"), "holds no faces"),
        (SQUARE.replace("property float z\n", "").replace(" 0\n", "\n") + "3 0 1 2\n", "its vertices lack z"),
        (HEAD.format(0) + "end_header\n", "holds no vertices"),
    ],
)
def test_a_mesh_that_would_crash_native_code_is_refused(tmp_path, text, message):
    with pytest.raises(FileError, match=message):
        read_mesh(written(tmp_path, text))


def test_a_broken_mesh_is_not_written(tmp_path):
    broken = Mesh(vertices=TETRAHEDRON.vertices, faces=np.array([[0, 1, 4]], np.int32))
    with pytest.raises(FileError, match="corners name a vertex that is not there"):
        write_mesh(tmp_path / "m.ply", broken)
    assert not (tmp_path / "m.ply").exists()


def test_points_come_back_bit_equal(tmp_path):
    random = np.random.default_rng(0)
    points = PointCloud(
        positions=random.normal(size=(9, 3)).astype(np.float32),
        colours=random.integers(0, 256, (9, 3), dtype=np.uint8),
        normals=random.normal(size=(9, 3)).astype(np.float32),
    )
    write_points(tmp_path / "p.ply", points)
    read = read_points(tmp_path / "p.ply")
    np.testing.assert_array_equal(read.positions, points.positions)
    np.testing.assert_array_equal(read.colours, points.colours)
    np.testing.assert_array_equal(read.normals, points.normals)


def test_points_without_colour_are_grey(tmp_path):
    points = read_points(written(tmp_path, HEAD.format(1) + "end_header\n1 2 3\n"))
    assert points.colours.tolist() == [[128, 128, 128]]
    assert points.normals is None


@pytest.mark.parametrize(
    ("columns", "row", "message"),
    [
        ("property uchar red\n", "1 2 3 1", "expected red, green, blue together"),
        ("property float nx\n", "1 2 3 1", "properties nx ny nz together"),
        ("property float nx\nproperty float ny\nproperty float nz\n", "1 2 3 0 nan 1", "vertices are not finite"),
    ],
)
def test_points_with_half_a_colour_or_normal_are_refused(tmp_path, columns, row, message):
    with pytest.raises(FileError, match=message):
        read_points(written(tmp_path, HEAD.format(1) + columns + f"end_header\n{row}\n"))


def test_damaged_meshes_raise_only_file_errors(tmp_path):
    write_mesh(tmp_path / "good.ply", TETRAHEDRON, OBSERVED)
    assert_only_file_errors(read_mesh, tmp_path / "good.ply", count=600)
    (tmp_path / "ascii.ply").write_text(SQUARE.replace("face 1", "face 2") + "3 0 1 2\n4 0 1 2 3\n")
    assert_only_file_errors(read_mesh, tmp_path / "ascii.ply", count=600)
    write_points(tmp_path / "points.ply", PointCloud(positions=TETRAHEDRON.vertices, colours=TETRAHEDRON.colours))
    assert_only_file_errors(read_points, tmp_path / "points.ply")


@pytest.mark.data
def test_ground_truth_meshes_and_points_are_read(data_root):
    mesh = read_mesh(data_root / "bench/living/gt/objects/1.ply")
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), 1)
    assert len(mesh.faces) > 100
    assert np.unique(edges, axis=0, return_counts=True)[1].max() <= 4  # a surface, not index soup
    size = np.ptp(mesh.vertices, axis=0)
    assert (size > 0.3).all()  # a sofa
    assert (size < 5).all()
    assert len(read_points(data_root / "real/redkitchen/fused_points.ply").positions) == 89849
