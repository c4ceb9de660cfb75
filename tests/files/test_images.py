import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from fuzz import assert_only_file_errors
from goc.errors import FileError
from goc.files import (
    image_size,
    read_depth,
    read_ids,
    read_image,
    read_normals,
    write_depth,
    write_ids,
    write_normals,
    write_png,
)

RANDOM = np.random.default_rng(0)
COLOUR = RANDOM.integers(0, 256, (5, 7, 3), dtype=np.uint8)
GREY = COLOUR[..., 0].copy()


def saved(path, image, **options):
    image.save(path, **options)
    return path


def test_colour_comes_back_as_written(tmp_path):
    write_png(tmp_path / "a.png", COLOUR)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), COLOUR)
    assert image_size(tmp_path / "a.png") == (7, 5)


def test_grey_palette_alpha_and_sixteen_bits_become_colour(tmp_path):
    expanded = np.repeat(GREY[..., None], 3, 2)
    grey = Image.fromarray(GREY)
    np.testing.assert_array_equal(read_image(saved(tmp_path / "l.png", grey)), expanded)
    np.testing.assert_array_equal(
        read_image(saved(tmp_path / "i.png", Image.fromarray(GREY.astype(np.uint16) << 8))), expanded
    )
    alpha = Image.fromarray(np.dstack([COLOUR, GREY]))
    np.testing.assert_array_equal(read_image(saved(tmp_path / "a.png", alpha)), COLOUR)
    palette = Image.fromarray(GREY)
    palette.putpalette([value for index in range(256) for value in (index, 0, 255 - index)])
    expected = np.dstack([GREY, np.zeros_like(GREY), 255 - GREY])
    np.testing.assert_array_equal(read_image(saved(tmp_path / "p.png", palette)), expected)


def test_an_exif_orientation_is_not_applied(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6  # rotate by 90 degrees to view
    path = saved(tmp_path / "turned.jpg", Image.fromarray(COLOUR), exif=exif, quality=95)
    assert read_image(path).shape == COLOUR.shape
    assert image_size(path) == (7, 5)


def test_depth_comes_back_in_metres_with_nan_for_none(tmp_path):
    depth = np.array([[0.001, 1.2344, 65.535], [np.nan, 70.0, -1.0]], np.float32)
    write_depth(tmp_path / "d.png", depth)
    expected = np.array([[0.001, 1.234, 65.535], [np.nan, np.nan, np.nan]], np.float32)
    np.testing.assert_allclose(read_depth(tmp_path / "d.png"), expected, rtol=1e-6)
    np.testing.assert_allclose(read_depth(tmp_path / "d.png", units_per_metre=5000.0), expected / 5, rtol=1e-6)


UNIT = RANDOM.normal(size=(5, 7, 3))
UNIT /= np.linalg.norm(UNIT, axis=-1, keepdims=True)


def test_normals_come_back_as_unit_vectors_with_nan_for_none(tmp_path):
    normals = UNIT.copy()
    normals[0, 0] = np.nan
    write_normals(tmp_path / "n.png", normals)
    found = read_normals(tmp_path / "n.png")
    np.testing.assert_array_equal(np.isnan(found[..., 0]), np.isnan(normals[..., 0]))
    np.testing.assert_allclose(found, normals, atol=0.006)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1)[1:], 1.0, rtol=1e-5)


def test_normals_of_sixteen_bits_are_read(tmp_path):
    """A PNG written by hand, since Pillow cannot: big-endian words after a filter byte a row."""
    words = np.rint((UNIT + 1) * 32767.5).astype(">u2")
    words[0, 0] = 0
    rows = b"".join(b"\0" + row.tobytes() for row in words)
    header = struct.pack(">IIBBBBB", 7, 5, 16, 2, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    png = b"".join(struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    (tmp_path / "n.png").write_bytes(b"\x89PNG\r\n\x1a\n" + png)
    found = read_normals(tmp_path / "n.png")
    assert np.isnan(found[0, 0]).all()
    np.testing.assert_allclose(found[1:], UNIT[1:], atol=0.01)


def test_a_grey_normal_image_is_refused(tmp_path):
    write_png(tmp_path / "n.png", GREY)
    with pytest.raises(FileError, match=r"n\.png: expected a normal image, found L pixels\. Write it as an RGB PNG"):
        read_normals(tmp_path / "n.png")


def test_depth_is_read_from_npy_without_unpickling(tmp_path):
    depth = np.array([[1.5, 0.0, np.inf]], np.float64)
    np.save(tmp_path / "d.npy", depth)
    np.testing.assert_array_equal(
        read_depth(tmp_path / "d.npy", units_per_metre=0.5), np.array([[3.0, np.nan, np.nan]], np.float32)
    )
    np.save(tmp_path / "o.npy", np.array([[{}]], object), allow_pickle=True)
    with pytest.raises(FileError, match=r"o\.npy: not a readable \.npy file"):
        read_depth(tmp_path / "o.npy")
    np.save(tmp_path / "c.npy", np.zeros((2, 2, 3)))
    with pytest.raises(FileError, match=r"expected an array \(h w\) of numbers, found \(2, 2, 3\)"):
        read_depth(tmp_path / "c.npy")
    np.savez(tmp_path / "z.npz", depth)
    (tmp_path / "z.npz").rename(tmp_path / "z.npy")
    with pytest.raises(FileError, match="not a readable"):
        read_depth(tmp_path / "z.npy")


@pytest.mark.parametrize("largest", [10, 254, 255, 300, 32767])
def test_ids_come_back_as_written(tmp_path, largest):
    ids = np.array([[0, 1, largest, -1]], np.int16)
    write_ids(tmp_path / "ids.png", ids)
    np.testing.assert_array_equal(read_ids(tmp_path / "ids.png"), ids)


def test_ids_are_read_from_palettes_and_grey_colours(tmp_path):
    stored = np.array([[0, 7, 255]], np.uint8)
    ids = np.array([[0, 7, -1]], np.int16)
    palette = Image.fromarray(stored)
    palette.putpalette(list(range(256)) * 3)
    np.testing.assert_array_equal(read_ids(saved(tmp_path / "p.png", palette)), ids)
    np.testing.assert_array_equal(read_ids(saved(tmp_path / "rgb.png", Image.fromarray(np.dstack([stored] * 3)))), ids)
    np.testing.assert_array_equal(read_ids(saved(tmp_path / "la.png", Image.fromarray(np.dstack([stored] * 2)))), ids)
    one_bit = Image.fromarray(stored > 0)
    np.testing.assert_array_equal(read_ids(saved(tmp_path / "1.png", one_bit)), [[0, 1, 1]])


def test_ids_that_cannot_be_are_refused(tmp_path):
    write_png(tmp_path / "c.png", COLOUR)
    with pytest.raises(FileError, match=r"c\.png: expected an id image with one channel, found RGB"):
        read_ids(tmp_path / "c.png")
    with pytest.raises(FileError, match="expected a depth image with one channel"):
        read_depth(tmp_path / "c.png")
    write_png(tmp_path / "big.png", np.full((2, 2), 40000, np.uint16))
    with pytest.raises(FileError, match="holds id 40000, beyond 32767"):
        read_ids(tmp_path / "big.png")


def test_a_pixel_bomb_is_refused_before_it_is_decoded(tmp_path):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    for side in (9_440, 50_000, 2_000_000):
        header = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0))
        path = tmp_path / f"{side}.png"
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b""))
        for read in (read_image, read_ids, read_depth, image_size):
            with pytest.raises(FileError, match="Scale the capture down"):
                read(path)


def test_cut_foreign_and_missing_files_are_refused(tmp_path):
    encoded = io.BytesIO()
    Image.fromarray(np.tile(COLOUR, (20, 20, 1))).save(encoded, format="JPEG")
    (tmp_path / "cut.jpg").write_bytes(encoded.getvalue()[: len(encoded.getvalue()) // 2])
    with pytest.raises(FileError, match=r"cut\.jpg: damaged or cut short"):
        read_image(tmp_path / "cut.jpg")
    (tmp_path / "text.png").write_text("<html>404</html>")
    for read in (read_image, image_size):
        with pytest.raises(FileError, match=r"text\.png: not a readable PNG, JPEG, WEBP, BMP, TIFF image"):
            read(tmp_path / "text.png")
        with pytest.raises(FileError, match=r"absent\.png: not found"):
            read(tmp_path / "absent.png")


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_damaged_images_raise_only_file_errors(tmp_path, suffix):
    path = saved(tmp_path / f"good{suffix}", Image.fromarray(np.tile(COLOUR, (4, 4, 1))))
    assert_only_file_errors(read_image, path)


def test_damaged_depth_and_ids_raise_only_file_errors(tmp_path):
    write_png(tmp_path / "good.png", np.tile(GREY, (4, 4)).astype(np.uint16))
    assert_only_file_errors(read_depth, tmp_path / "good.png")
    assert_only_file_errors(read_ids, tmp_path / "good.png", seed=1)
    np.save(tmp_path / "good.npy", np.ones((8, 9), np.float32))
    assert_only_file_errors(read_depth, tmp_path / "good.npy")
