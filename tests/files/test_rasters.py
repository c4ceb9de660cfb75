"""Depth as programs store it."""

import io

import numpy as np
import pytest
from PIL import Image

from goc.errors import FileError
from goc.files import depth_of, picture_size, raster_size, read_depth, read_image, read_picture, read_raster

DEPTH = np.array([[1.5, 0.0, 2.25], [np.nan, 3.0, np.inf]], np.float32)


def exr(path, channel="Z"):
    library = pytest.importorskip("OpenEXR", reason="extra goc[formats]")
    header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage}
    library.File(header, {channel: DEPTH}).write(str(path))


def npz(path):
    np.savez(path, depth=DEPTH)


def pfm(path):
    path.write_bytes(b"Pf\n3 2\n-1.0\n" + DEPTH[::-1].astype("<f4").tobytes())


def tiff(path):
    Image.fromarray(DEPTH).save(path)


def npy(path):
    np.save(path, DEPTH[None])  # one channel first, as networks write it


@pytest.mark.parametrize(
    ("suffix", "write"), [(".exr", exr), (".npz", npz), (".pfm", pfm), (".tiff", tiff), (".npy", npy)]
)
def test_fractions_are_read_as_they_are_stored(tmp_path, suffix, write):
    path = tmp_path / f"depth{suffix}"
    write(path)
    np.testing.assert_array_equal(read_raster(path), DEPTH)
    assert raster_size(path) == (3, 2)
    expected = np.where(np.isfinite(DEPTH) & (DEPTH > 0), DEPTH, np.nan)
    np.testing.assert_array_equal(read_depth(path, 1.0), expected)


@pytest.mark.parametrize("suffix", [".exr", ".npz", ".pfm", ".tiff", ".npy"])
def test_damaged_files_are_one_error(tmp_path, suffix):
    if suffix == ".exr":
        pytest.importorskip("OpenEXR", reason="extra goc[formats]")
    path = tmp_path / f"depth{suffix}"
    path.write_bytes(b"Pf\nnot what it says")
    with pytest.raises(FileError, match=r"depth\.\w+: not a readable .*again"):
        read_raster(path)
    with pytest.raises(FileError, match="not found"):
        read_raster(tmp_path / f"absent{suffix}")


def test_what_has_no_depth_in_it_is_told(tmp_path):
    exr(tmp_path / "a.exr", channel="normal")
    exr(tmp_path / "b.exr", channel="depth")
    np.testing.assert_array_equal(read_raster(tmp_path / "b.exr"), DEPTH)
    np.testing.assert_array_equal(read_raster(tmp_path / "a.exr"), DEPTH)  # the only channel there is
    np.savez(tmp_path / "two.npz", rgb=DEPTH, mask=DEPTH)
    with pytest.raises(FileError, match=r"two\.npz: holds mask, rgb, no array named depth"):
        read_raster(tmp_path / "two.npz")


def test_a_saturated_sensor_measured_nothing():
    stored = np.array([[0, 1000, 65535]], np.uint16)
    np.testing.assert_array_equal(depth_of(stored, 1000.0), np.array([[np.nan, 1.0, np.nan]], np.float32))
    np.testing.assert_array_equal(depth_of(stored, 65535.0, saturates=False)[0, 2], np.float32(1.0))


def test_orientation_is_told_and_applied_only_when_asked_for(tmp_path):
    pixels = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3) * 3
    exif = Image.Exif()
    exif[0x0112] = 6  # turn clockwise to see it upright
    Image.fromarray(pixels).save(tmp_path / "a.png", exif=exif)
    size = picture_size(tmp_path / "a.png")
    assert (size.stored, size.upright, size.has_alpha) == ((6, 4), (4, 6), False)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), pixels)
    np.testing.assert_array_equal(read_picture(tmp_path / "a.png", upright=True)[0], np.rot90(pixels, -1))


def test_transparency_comes_beside_the_colours(tmp_path):
    pixels = np.full((4, 6, 4), 90, np.uint8)
    pixels[:, :2, 3] = 0
    Image.fromarray(pixels).save(tmp_path / "a.png")
    colours, alpha = read_picture(tmp_path / "a.png")
    assert colours.shape == (4, 6, 3) and (colours == 90).all()
    np.testing.assert_array_equal(alpha, pixels[..., 3])
    assert picture_size(tmp_path / "a.png").has_alpha
    assert read_picture(_saved(tmp_path / "b.png", pixels[..., :3]))[1] is None


def test_heic_of_no_phone_is_one_error(tmp_path):
    pytest.importorskip("pi_heif", reason="extra goc[formats]")
    encoded = io.BytesIO()
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(encoded, format="JPEG")
    (tmp_path / "a.heic").write_bytes(encoded.getvalue()[:40])
    with pytest.raises(FileError, match=r"a\.heic: not a readable HEIC image"):
        read_image(tmp_path / "a.heic")


def _saved(path, pixels):
    Image.fromarray(pixels).save(path)
    return path
