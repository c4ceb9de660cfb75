"""Scans of every kind that is read, and what is told of those that are not."""

import numpy as np
import pytest
import trimesh

from fuzz import assert_only_file_errors
from goc.errors import FileError
from goc.files import read_scan, write_mesh, write_ply, write_points
from goc.scene import Mesh, PointCloud
from solids import cube

ROWS = np.array([[0.0, 1.0, 2.0, 0.6, 0.0, 0.8], [-3.5, 4.25, 1e-3, 0.0, -1.0, 0.0]])
RED = np.array([[1.0, 0.0, 0.25], [0.5, 0.25, 0.0]])
PLACE = np.array([483_250.0, 4_605_120.0, 812.0])


def written(tmp_path, text, name="scan.xyz"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def lines(rows) -> str:
    return "\n".join(" ".join(f"{value:g}" for value in row) for row in rows)


def points_of(path) -> PointCloud:
    cloud = read_scan(path).surface
    assert isinstance(cloud, PointCloud)
    return cloud


def shell(count=4000):
    """Points of a ball of radius 1, and their directions."""
    way = np.random.default_rng(0).normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1, keepdims=True)


@pytest.mark.parametrize("name", ["scan.xyz", "scan.TXT", "scan.pts", "scan.asc"])
def test_bare_points_are_grey(tmp_path, name):
    scan = points_of(written(tmp_path, "# x y z\n" + lines(ROWS[:, :3]) + "\n", name))
    assert scan.normals is None
    np.testing.assert_allclose(scan.positions, ROWS[:, :3], rtol=1e-6)
    assert (scan.colours == 128).all()


def test_columns_are_normals_by_their_length_and_colours_by_their_range(tmp_path):
    places, normals = ROWS[:, :3], ROWS[:, 3:]
    bytes_ = np.rint(RED * 255)
    for rows, has_normals, has_colours in (
        (np.c_[places, normals], True, False),
        (np.c_[places, RED], False, True),
        (np.c_[places, bytes_], False, True),
        (np.c_[places, normals, RED], True, True),
        (np.c_[places, bytes_, normals], True, True),
        (np.c_[places, [17.0, -3.0], bytes_], False, True),
        (np.c_[places, [17.0, -3.0], bytes_, normals], True, True),
        (np.c_[places, [17.0, -3.0]], False, False),
    ):
        scan = points_of(written(tmp_path, lines(rows)))
        assert (scan.normals is not None) == has_normals
        if has_normals:
            np.testing.assert_allclose(scan.normals, normals, rtol=1e-6)
        np.testing.assert_array_equal(scan.colours, bytes_ if has_colours else np.full((2, 3), 128))


def test_columns_that_are_neither_are_left_out_and_told(tmp_path):
    scan = read_scan(written(tmp_path, lines(np.c_[ROWS[:, :3], [[-5, 2, 3], [400, 5, 6]]])))
    assert scan.surface.normals is None and (scan.surface.colours == 128).all()
    assert scan.remarks == ("columns 4 to 6 are neither unit normals nor colours of 0 to 1 or 0 to 255: not used",)


def test_named_columns_are_believed(tmp_path):
    text = "//X,Y,Z,Intensity,R,G,B,Nx,Ny,Nz\n" + lines(np.c_[ROWS[:, :3], [1, 2], RED, ROWS[:, 3:]]).replace(" ", ",")
    scan = points_of(written(tmp_path, text, "scan.csv"))
    np.testing.assert_allclose(scan.normals, ROWS[:, 3:], rtol=1e-6)
    np.testing.assert_array_equal(scan.colours, np.rint(RED * 255))


def test_a_count_at_the_start_is_checked(tmp_path):
    assert len(points_of(written(tmp_path, "2\n" + lines(ROWS[:, :3]), "scan.pts")).positions) == 2
    with pytest.raises(FileError, match=r"scan\.pts: announces 3 points and holds 2"):
        read_scan(written(tmp_path, "3\n" + lines(ROWS[:, :3]), "scan.pts"))


def test_ply_is_a_mesh_or_points_by_what_it_holds(tmp_path):
    write_mesh(tmp_path / "mesh.ply", cube())
    write_points(tmp_path / "points.ply", PointCloud(positions=cube().vertices, colours=cube().colours))
    assert isinstance(read_scan(tmp_path / "mesh.ply").surface, Mesh)
    assert len(points_of(tmp_path / "points.ply").positions) == 8
    vertex = {name: cube().vertices[:, axis].astype(np.float64) for axis, name in enumerate("xyz")}
    write_ply(tmp_path / "none.ply", {"vertex": vertex, "face": {"vertex_indices": np.zeros((0, 3), np.int32)}})
    assert len(points_of(tmp_path / "none.ply").positions) == 8


@pytest.mark.parametrize(
    ("kind", "colour"),
    [("u1", [255, 0, 64]), ("u2", [65535, 0, 16448]), ("f4", [1.0, 0.0, 0.25]), ("i4", [255, 0, 64])],
)
@pytest.mark.parametrize("place", ["f4", "f8", "i2", "u1"])
def test_ply_of_any_types(tmp_path, kind, colour, place):
    vertex = {name: np.array([0, 1, 2 + axis]).astype(place) for axis, name in enumerate("xyz")}
    vertex |= {
        name: np.full(3, value).astype(kind) for name, value in zip(("red", "green", "blue"), colour, strict=True)
    }
    write_ply(tmp_path / "any.ply", {"vertex": vertex})
    scan = points_of(tmp_path / "any.ply")
    np.testing.assert_array_equal(scan.positions, [[0, 0, 0], [1, 1, 1], [2, 3, 4]])
    np.testing.assert_array_equal(scan.colours, np.tile([[255, 0, 64]], (3, 1)))


def test_pcl_tells_in_a_ply_where_it_stood(tmp_path):
    vertex = {name: np.arange(3, dtype=np.float32) for name in "xyz"}
    camera = {f"view_p{name}": np.array([value], np.float32) for name, value in zip("xyz", (1, 2, 3), strict=True)}
    write_ply(tmp_path / "pcl.ply", {"vertex": vertex, "camera": camera})
    assert points_of(tmp_path / "pcl.ply").seen_from.tolist() == [1, 2, 3]


@pytest.mark.parametrize("suffix", ["glb", "gltf", "obj", "stl", "off"])
def test_meshes_of_other_tools_are_welded(tmp_path, suffix):
    exported = trimesh.creation.box((1.0, 2.0, 3.0)).export(file_type=suffix)
    if suffix == "gltf":
        for name, data in exported.items():
            (tmp_path / name).write_bytes(data)
        (tmp_path / "model.gltf").rename(tmp_path / "box.gltf")
    else:
        (tmp_path / f"box.{suffix}").write_bytes(exported.encode() if isinstance(exported, str) else exported)
    scan = read_scan(tmp_path / f"box.{suffix}").surface
    assert isinstance(scan, Mesh) and (len(scan.vertices), len(scan.faces)) == (8, 12)


def test_meshes_without_faces_are_points(tmp_path):
    places = np.random.default_rng(0).uniform(size=(60, 3))
    cloud = trimesh.PointCloud(places, colors=np.tile([10, 200, 30, 255], (60, 1)))
    trimesh.Scene([cloud]).export(tmp_path / "points.glb")
    rows = np.c_[places, np.tile([10 / 255, 200 / 255, 30 / 255], (60, 1))]
    (tmp_path / "points.obj").write_text("\n".join("v " + " ".join(f"{value:.6f}" for value in row) for row in rows))
    for name in ("points.glb", "points.obj"):
        scan = points_of(tmp_path / name)
        np.testing.assert_allclose(scan.positions, places, atol=1e-5)
        np.testing.assert_array_equal(scan.colours, np.tile([[10, 200, 30]], (60, 1)))


def as_las(path, places, colours):
    laspy = pytest.importorskip("laspy", reason="goc[formats] is not installed")
    header = laspy.LasHeader(point_format=2, version="1.2")
    header.scales, header.offsets = np.full(3, 1e-4), np.floor(places.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = places.T
    las.red, las.green, las.blue = colours.T.astype(np.uint16) * 257
    las.write(path)


def as_e57(path, places, colours):
    pye57 = pytest.importorskip("pye57", reason="goc[formats] is not installed")
    stood = np.floor(places.min(axis=0))
    data = {f"cartesian{axis}": places[:, i] - stood[i] for i, axis in enumerate("XYZ")}
    data |= {f"color{name}": colours[:, i].copy() for i, name in enumerate(("Red", "Green", "Blue"))}
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw(data, rotation=np.array([1.0, 0, 0, 0]), translation=stood)
    file.close()


def as_ply(path, places, colours):
    vertex = {name: places[:, axis] for axis, name in enumerate("xyz")}
    write_ply(path, {"vertex": vertex | {name: colours[:, i] for i, name in enumerate(("red", "green", "blue"))}})


def as_text(path, places, colours):
    np.savetxt(path, np.c_[places, colours], fmt="%.4f")


WRITERS = {"a.las": as_las, "a.laz": as_las, "a.e57": as_e57, "a.ply": as_ply, "a.xyz": as_text}


@pytest.mark.parametrize("name", WRITERS)
def test_national_grids_lose_no_digits(tmp_path, name):
    way = shell()
    colours = np.rint(127 + 120 * way).astype(np.uint8)
    WRITERS[name](tmp_path / name, PLACE + way, colours)
    scan = read_scan(tmp_path / name)
    assert scan.offset.tolist() == [483_250.0, 4_605_120.0, 810.0]
    assert any("far from its origin: computed about 483250 4605120 810" in words for words in scan.remarks)
    np.testing.assert_allclose(scan.surface.positions, way + [0, 0, 2], atol=2e-4)
    np.testing.assert_array_equal(scan.surface.colours, colours)


def test_a_mesh_far_away_loses_none_either(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.apply_translation(PLACE)
    (tmp_path / "ball.obj").write_text(ball.export(file_type="obj", digits=6))
    scan = read_scan(tmp_path / "ball.obj")
    assert isinstance(scan.surface, Mesh)
    np.testing.assert_allclose(np.linalg.norm(scan.surface.vertices - [0, 0, 2], axis=1), 1, atol=1e-4)


def test_points_that_lost_their_digits_are_refused(tmp_path):
    as_ply(tmp_path / "a.ply", (PLACE + shell()).astype(np.float32), np.zeros((4000, 3), np.uint8))
    with pytest.raises(FileError, match=r"a\.ply: its 4,000 points are 0\.5 apart in steps, for want of digits"):
        read_scan(tmp_path / "a.ply")


def test_points_near_their_origin_stay_where_they_are(tmp_path):
    for places in (shell() + [3.0, 0, 0], 1000 * shell() + [0, 0, 9000.0]):
        as_ply(tmp_path / "a.ply", places, np.zeros((4000, 3), np.uint8))
        scan = read_scan(tmp_path / "a.ply")
        assert not scan.offset.any() and scan.remarks == ()


@pytest.mark.parametrize("name", ["a.ply", "a.xyz"])
def test_points_of_an_organised_cloud_that_are_not_there_are_counted(tmp_path, name):
    places = shell(200)
    places[::4, 1] = np.nan
    WRITERS[name](tmp_path / name, places, np.zeros((200, 3), np.uint8))
    scan = read_scan(tmp_path / name)
    assert len(scan.surface.positions) == 150
    assert scan.remarks == ("50 of its 200 points have no finite place: left out",)


@pytest.mark.parametrize("name", ["a.las", "a.laz", "a.xyz", "a.ply"])
def test_damaged_files_end_in_one_line(tmp_path, name):
    WRITERS[name](tmp_path / name, shell(60), np.zeros((60, 3), np.uint8))
    assert_only_file_errors(read_scan, tmp_path / name, 120)


@pytest.mark.parametrize(("name", "library"), [("a.laz", "lazrs"), ("a.e57", "pye57")])
def test_an_extra_that_is_not_installed_is_named(tmp_path, monkeypatch, name, library):
    WRITERS[name](tmp_path / name, shell(60), np.zeros((60, 3), np.uint8))
    monkeypatch.setitem(__import__("sys").modules, library, None)
    with pytest.raises(FileError, match=r"is read by an extra\. Run `pip install goc\[formats\]`"):
        read_scan(tmp_path / name)
    with pytest.raises(FileError, match=r"absent\.e57: not found"):
        read_scan(tmp_path / "absent.e57")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no points"),
        ("  \n\n", "holds no points"),
        ("1 2\n", "2 numbers a line; 3, 6 or 9"),
        ("1 2 3 4 5\n", "5 numbers a line"),
        ("1 2 3\n1 2\n", "not numbers in equal rows"),
        ("1 2 three\n", "not numbers in equal rows"),
        ("nan 2 3\n1 inf 3\n", "holds no points"),
        ("1e300 2 3\n1 2 3\n", "beyond single precision"),
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
