"""Point clouds as PCL writes them."""

import numpy as np
import pytest

from goc.errors import FileError
from goc.files import read_scan

POINTS = np.array([[0.5, 1, 2], [3, 4, 5], [np.nan, 0, 0], [6, 7, -8.25]], np.float32)
COLOUR = (200 << 16) + (100 << 8) + 50


def header(data, viewpoint="0.1 0.2 -3 1 0 0 0"):
    return (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb normal_x normal_y normal_z\n"
        f"SIZE 4 4 4 4 4 4 4\nTYPE F F F U F F F\nCOUNT 1 1 1 1 1 1 1\nWIDTH 4\nHEIGHT 1\nVIEWPOINT {viewpoint}\n"
        f"POINTS 4\nDATA {data}\n"
    ).encode()


def table():
    found = np.zeros(4, [("p", "<f4", 3), ("rgb", "<u4"), ("n", "<f4", 3)])
    found["p"], found["rgb"], found["n"] = POINTS, COLOUR, [0, 0, 1]
    return found


def literal_runs(data):
    """LZF without any copies."""
    parts = [data[at : at + 32] for at in range(0, len(data), 32)]
    return b"".join(bytes([len(part) - 1]) + part for part in parts)


def body(kind):
    rows = table()
    if kind == "ascii":
        return "\n".join(" ".join(map(str, [*p, COLOUR, *n])) for p, _, n in rows).encode()
    if kind == "binary":
        return rows.tobytes()
    columns = [rows["p"][:, 0], rows["p"][:, 1], rows["p"][:, 2], rows["rgb"], *rows["n"].T]
    data = b"".join(np.ascontiguousarray(column).tobytes() for column in columns)
    packed = literal_runs(data[:-32]) + bytes([31]) + data[-32:]
    return np.array([len(packed), len(data)], "<u4").tobytes() + packed


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_all_encodings_are_read(tmp_path, kind):
    path = tmp_path / "cloud.pcd"
    path.write_bytes(header(kind) + body(kind))
    cloud = read_scan(path).surface
    np.testing.assert_array_equal(cloud.positions, POINTS[[0, 1, 3]])
    np.testing.assert_array_equal(cloud.colours, [[200, 100, 50]] * 3)
    np.testing.assert_array_equal(cloud.normals, [[0, 0, 1]] * 3)
    np.testing.assert_allclose(cloud.seen_from, [0.1, 0.2, -3])


def test_copies_that_overlap_themselves_are_unpacked(tmp_path):
    """Four points at (1, 1, 1): one literal float, and a copy of it over and over."""
    one = np.float32(1).tobytes()
    length = 4 * 3 * 4
    packed = bytes([3]) + one + bytes([(7 << 5), length - 4 - 2 - 7, 3])
    text = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA binary_compressed\n"
    path = tmp_path / "ones.pcd"
    path.write_bytes(text.encode() + np.array([len(packed), length], "<u4").tobytes() + packed)
    cloud = read_scan(path).surface
    np.testing.assert_array_equal(cloud.positions, np.ones((4, 3)))
    assert cloud.seen_from is None and cloud.normals is None


def test_the_viewpoint_that_all_files_have_says_nothing(tmp_path):
    path = tmp_path / "cloud.pcd"
    path.write_bytes(header("ascii", "0 0 0 1 0 0 0") + body("ascii"))
    assert read_scan(path).surface.seen_from is None


@pytest.mark.parametrize(
    "damaged",
    [
        b"",
        b"VERSION 0.7\n",
        header("binary") + body("binary")[:-9],
        header("zipped"),
        header("ascii") + b"1 2\n3 4\n",
        header("binary_compressed") + body("binary_compressed")[:-9],
        header("binary_compressed") + np.array([3, 9], "<u4").tobytes() + bytes([255, 255, 255]),
    ],
)
def test_damaged_files_are_refused(tmp_path, damaged):
    path = tmp_path / "cloud.pcd"
    path.write_bytes(damaged)
    with pytest.raises(FileError, match=r"cloud\.pcd: not a readable PCD file"):
        read_scan(path)


def test_a_cloud_without_any_point_is_refused(tmp_path):
    path = tmp_path / "cloud.pcd"
    path.write_bytes(header("ascii") + b"nan nan nan 0 0 0 1\n" * 4)
    with pytest.raises(FileError, match="holds no points"):
        read_scan(path)
