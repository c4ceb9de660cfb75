"""Scans of every kind that is read, and what is told of those that are not."""

import numpy as np
import pytest
import trimesh

from goc.errors import FileError
from goc.files import read_scan, write_mesh, write_points
from goc.scene import Mesh, PointCloud
from solids import cube

ROWS = np.array([[0.0, 1.0, 2.0, 0.6, 0.0, 0.8], [-3.5, 4.25, 1e-3, 0.0, -1.0, 0.0]])


def written(tmp_path, text, name="scan.xyz"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def lines(rows) -> str:
    return "\n".join(" ".join(f"{value:g}" for value in row) for row in rows)


@pytest.mark.parametrize("name", ["scan.xyz", "scan.TXT", "scan.pts"])
def test_bare_points_are_grey(tmp_path, name):
    scan = read_scan(written(tmp_path, "# x y z\n" + lines(ROWS[:, :3]) + "\n", name))
    assert isinstance(scan, PointCloud) and scan.normals is None
    np.testing.assert_allclose(scan.positions, ROWS[:, :3], rtol=1e-6)
    assert (scan.colours == 128).all()


def test_six_numbers_are_a_normal_where_they_are_small_and_a_colour_otherwise(tmp_path):
    scan = read_scan(written(tmp_path, lines(ROWS)))
    np.testing.assert_allclose(scan.normals, ROWS[:, 3:], rtol=1e-6)
    coloured = read_scan(written(tmp_path, lines(np.c_[ROWS[:, :3], [[255, 0, 300], [7.6, -4, 20]]])))
    assert coloured.normals is None and coloured.colours.tolist() == [[255, 0, 255], [8, 0, 20]]


def test_nine_numbers_are_colour_then_normal(tmp_path):
    scan = read_scan(written(tmp_path, lines(np.c_[ROWS[:, :3], [[1, 2, 3], [4, 5, 6]], ROWS[:, 3:]])))
    assert scan.colours.tolist() == [[1, 2, 3], [4, 5, 6]]
    np.testing.assert_allclose(scan.normals, ROWS[:, 3:], rtol=1e-6)


def test_ply_is_a_mesh_or_points_by_what_it_holds(tmp_path):
    write_mesh(tmp_path / "mesh.ply", cube())
    write_points(tmp_path / "points.ply", PointCloud(positions=cube().vertices, colours=cube().colours))
    assert isinstance(read_scan(tmp_path / "mesh.ply"), Mesh)
    assert isinstance(read_scan(tmp_path / "points.ply"), PointCloud)


@pytest.mark.parametrize("suffix", ["glb", "obj"])
def test_meshes_of_other_tools_are_welded(tmp_path, suffix):
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / f"box.{suffix}")
    scan = read_scan(tmp_path / f"box.{suffix}")
    assert isinstance(scan, Mesh) and (len(scan.vertices), len(scan.faces)) == (8, 12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no points"),
        ("  \n\n", "holds no points"),
        ("1 2\n", "2 numbers a line; 3, 6 or 9 are expected"),
        ("1 2 3 4\n", "4 numbers a line"),
        ("1 2 3\n1 2\n", "not numbers in equal rows"),
        ("1 2 three\n", "not numbers in equal rows"),
        ("1 2 3\nnan 2 3\n1 inf 3\n", r"2 of 3 points are not finite \(first: 1\)"),
    ],
)
def test_text_that_is_no_points_is_refused(tmp_path, text, message):
    with pytest.raises(FileError, match=rf"scan\.xyz: .*{message}"):
        read_scan(written(tmp_path, text))


def test_other_files_are_refused_by_their_name(tmp_path):
    with pytest.raises(FileError, match=r"scan\.stp: not a scan that goc reads. Convert it to one of .*\.ply.*\.xyz"):
        read_scan(written(tmp_path, "ISO-10303-21;", "scan.stp"))
    with pytest.raises(FileError, match=r"absent\.xyz"):
        read_scan(tmp_path / "absent.xyz")
