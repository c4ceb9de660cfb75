import numpy as np
import pytest

from goc.errors import FileError
from goc.files import Lists, read_ply, write_ply


def written(tmp_path, text, body=b""):
    path = tmp_path / "file.ply"
    path.write_bytes(text.encode() + body)
    return path


def header(*lines, form="binary_little_endian"):
    return "\n".join(["ply", f"format {form} 1.0", *lines, "end_header\n"])


FACES = ("element face 2", "property list uchar int vertex_indices")


def test_every_type_comes_back_bit_equal(tmp_path):
    codes = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]
    random = np.random.default_rng(0)
    columns = {f"column_{code}": np.frombuffer(random.bytes(64), code)[:5].copy() for code in codes}
    columns["column_f4"] = np.array([0, -0.0, np.nan, np.inf, 1e-45], np.float32)
    write_ply(
        tmp_path / "a.ply", {"vertex": columns, "face": {"vertex_indices": np.arange(6, dtype=np.int32).reshape(2, 3)}}
    )
    read = read_ply(tmp_path / "a.ply")
    for name, column in columns.items():
        assert read["vertex"][name].dtype == column.dtype
        assert read["vertex"][name].tobytes() == column.tobytes()
    lists = read["face"]["vertex_indices"]
    np.testing.assert_array_equal(lists.counts, [3, 3])
    np.testing.assert_array_equal(lists.values, np.arange(6))


def test_ascii_and_both_byte_orders_say_the_same(tmp_path):
    lines = ("comment made by hand", "element vertex 2", "property float x", "property uchar red", *FACES)
    vertex = [("x", "f4"), ("red", "u1")]
    readings = []
    for form, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        rows = np.array([(1.5, 7), (-2.25, 255)], [(name, order + code) for name, code in vertex]).tobytes()
        faces = (
            b"\x03"
            + np.array([0, 1, 1], order + "i4").tobytes()
            + b"\x04"
            + np.array([0, 1, 1, 0], order + "i4").tobytes()
        )
        readings.append(read_ply(written(tmp_path, header(*lines, form=form), rows + faces)))
    readings.append(
        read_ply(written(tmp_path, header(*lines, form="ascii"), b"1.5 7\n-2.25 255\n3 0 1 1\n4 0 1 1 0\n"))
    )
    for reading in readings:
        np.testing.assert_array_equal(reading["vertex"]["x"], np.array([1.5, -2.25], np.float32))
        np.testing.assert_array_equal(reading["vertex"]["red"], np.array([7, 255], np.uint8))
        assert reading["vertex"]["red"].dtype == np.uint8
        assert isinstance(reading["face"]["vertex_indices"], Lists)
        np.testing.assert_array_equal(reading["face"]["vertex_indices"].counts, [3, 4])
        np.testing.assert_array_equal(reading["face"]["vertex_indices"].values, [0, 1, 1, 0, 1, 1, 0])
        assert reading["face"]["vertex_indices"].values.dtype == np.int32


def test_uniform_and_ragged_reading_agree(tmp_path):
    """The fast path (all lists as long as the first) and the row by row path are twins."""
    lines = ("element face 3", "property list uchar int vertex_indices", "property short group")
    triangles = [(3, [0, 1, 2], 5), (3, [3, 4, 5], 6), (3, [6, 7, 8], 7)]

    def body(rows):
        return b"".join(
            bytes([count]) + np.array(values, "<i4").tobytes() + np.array(group, "<i2").tobytes()
            for count, values, group in rows
        )

    fast = read_ply(written(tmp_path, header(*lines), body(triangles)))["face"]
    ragged = read_ply(written(tmp_path, header(*lines), body([*triangles[:2], (0, [], 7)])))["face"]
    np.testing.assert_array_equal(fast["vertex_indices"].values[:6], ragged["vertex_indices"].values)
    np.testing.assert_array_equal(ragged["vertex_indices"].counts, [3, 3, 0])
    np.testing.assert_array_equal(fast["group"], ragged["group"])


def test_windows_line_ends_and_empty_elements_are_read(tmp_path):
    lines = ("element vertex 1", "property float x", "element face 0", "property list uchar int vertex_indices")
    text = header(*lines).replace("\n", "\r\n")
    read = read_ply(written(tmp_path, text, np.float32(3).tobytes()))
    assert read["vertex"]["x"][0] == 3
    assert len(read["face"]["vertex_indices"].counts) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("obj\n", "does not start with the word ply"),
        ("ply\nformat ascii 1.0\n", "header has no end"),
        ("ply\nelement vertex 0\nend_header\n", "names no format"),
        ("ply\nformat ascii 2.0\nend_header\n", "header line not understood: 'format ascii 2.0'"),
        (header("element vertex -1"), "not understood: 'element vertex -1'"),
        (header("element vertex 1_0"), "not understood"),
        (header("element vertex 1"), "has 1 rows but no properties"),
        (header("property float x"), "not understood: 'property float x'"),
        (header("element vertex 0", "property real x"), "not understood: 'property real x'"),
        (header("element vertex 0", "property float x", "property int x"), "property x occurs twice"),
        (header("element vertex 0", "element vertex 0"), "not understood: 'element vertex 0'"),
        (header("element face 0", "property list float int x"), "list x has a length that is not an integer"),
        (header("comment größe"), "header is not ascii"),
    ],
)
def test_a_header_that_makes_no_sense_is_refused(tmp_path, text, message):
    with pytest.raises(FileError, match=rf"file\.ply: not a sound PLY file: .*{message}"):
        read_ply(written(tmp_path, text))


@pytest.mark.parametrize(
    ("lines", "body", "message"),
    [
        (("element vertex 999999999999", "property double x"), bytes(80), "need 7999999999992 bytes, 80 are there"),
        (("element vertex 2", "property double x"), bytes(15), "2 rows of vertex need 16 bytes, 15 are there"),
        (("element vertex 1", "property uchar x"), bytes(1) + b"left", "4 bytes more than its header announces"),
        (("element face 1", "property list uint int v"), b"\xff\xff\xff\xff" + bytes(8), "cut short"),
        (("element face 1", "property list char int v"), b"\xff" + bytes(8), "has length -1"),
        (
            ("element face 2", "property list uchar int v"),
            b"\x01" + bytes(4) + b"\x09" + bytes(4),
            "need 36 more bytes",
        ),
        (
            ("element face 1", "property list uint int v", "property list uint int w"),
            b"\xff\xff\xff\xff" * 2,
            "cut short",
        ),
    ],
)
def test_counts_beyond_the_file_are_refused(tmp_path, lines, body, message):
    with pytest.raises(FileError, match=message):
        read_ply(written(tmp_path, header(*lines), body))


@pytest.mark.parametrize(
    ("lines", "body", "message"),
    [
        (("element vertex 9", "property float x"), b"1 2 3", "9 rows of vertex need 9 numbers, 3 are there"),
        (("element vertex 1", "property float x"), b"1 2 3", "2 numbers more than its header announces"),
        (("element vertex 1", "property float x"), b"one", "something that is not a number"),
        (("element vertex 1", "property float x"), b"1" * 70, "more than 64 characters"),
        (("element vertex 2", "property uchar x"), b"1 256", "property x is 256 in 1 rows, not a u1 integer"),
        (("element vertex 1", "property int x"), b"1.5", "property x is 1.5 in 1 rows"),
        (("element vertex 1", "property int x"), b"nan", "property x is nan in 1 rows"),
        (("element face 1", "property list uchar int v"), b"-1 2", "has length b'-1'"),
        (("element face 1", "property list uchar int v"), b"3 1 2", "need 3 more numbers, 2 are there"),
        (("element face 2", "property list uchar int v"), b"1 1", "need 1 more numbers, 0 are there"),
    ],
)
def test_ascii_that_does_not_fit_is_refused(tmp_path, lines, body, message):
    with pytest.raises(FileError, match=message):
        read_ply(written(tmp_path, header(*lines, form="ascii"), body))


def test_a_long_name_does_not_fill_the_screen(tmp_path):
    with pytest.raises(FileError) as caught:
        read_ply(written(tmp_path, header("element " + "[" * 5000 + " 9", "property float x")))
    assert len(str(caught.value)) < 500
