"""COLMAP's models, written here byte by byte as its documentation lays them out."""

import struct

import numpy as np
import pytest

from captures import LENS, poses, see
from goc.capture import CaptureConfig, load_capture
from goc.capture.readers.colmap_model import read_cameras
from goc.errors import CaptureError, FileError
from goc.files import write_ids, write_png

NUMBERS = (*LENS.focal_px, *LENS.centre_px)


def quaternion(rotation):
    """w x y z; Shepperd's formula where the trace is positive, else by the largest axis."""
    values, vectors = np.linalg.eigh(_davenport(rotation))
    x, y, z, w = vectors[:, values.argmax()]
    return w, x, y, z


def _davenport(m):
    """The symmetric matrix whose first eigenvector is the quaternion (x y z w)."""
    trace = np.trace(m)
    k = np.zeros((4, 4))
    k[:3, :3] = m + m.T - trace * np.eye(3)
    k[:3, 3] = k[3, :3] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    k[3, 3] = trace
    return k / 3


def write_images(folder, count=4):
    for number, pose in enumerate(poses(count)):
        shot = see(pose)
        write_png(folder / "images" / "cam a" / f"{number}.png", shot.image)
        write_ids(folder / "instance" / "cam a" / f"{number}.png", shot.ids)


def write_binary(model, count=4, camera=7):
    model.mkdir(parents=True)
    entries = struct.pack("<QIiQQ4d", 2, 3, 0, 10, 10, 5.0, 5.0, 5.0, 0)[: 8 + 24 + 24]
    entries += struct.pack("<IiQQ4d", camera, 1, LENS.width, LENS.height, *NUMBERS)
    (model / "cameras.bin").write_bytes(entries)
    data = struct.pack("<Q", count)
    for number, pose in reversed(list(enumerate(poses(count)))):
        seen = np.linalg.inv(pose)
        data += struct.pack("<I7dI", 90 - number, *quaternion(seen[:3, :3]), *seen[:3, 3], camera)
        data += f"cam a/{number}.png".encode() + b"\0"
        data += struct.pack("<QddQddQ", 2, 1.0, 2.0, 5, 3.0, 4.0, 2**64 - 1)
    (model / "images.bin").write_bytes(data)
    points = struct.pack("<QQ3d3BdQII", 1, 5, 1.0, 2.0, 3.0, 10, 20, 30, 0.5, 1, 90, 0)
    (model / "points3D.bin").write_bytes(points)
    return model


def write_text(model, count=4):
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text(
        "# comment\n7 PINHOLE 64 48 " + " ".join(f"{number:.17g}" for number in NUMBERS) + "\n"
    )
    lines = ["# IMAGE_ID, QW, …", "# POINTS2D"]
    for number, pose in enumerate(poses(count)):
        seen = np.linalg.inv(pose)
        numbers = " ".join(f"{value:.17g}" for value in (*quaternion(seen[:3, :3]), *seen[:3, 3]))
        lines += [f"{number + 1} {numbers} 7 cam a/{number}.png", "" if number % 2 else "1.0 2.0 -1"]
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    return model


@pytest.mark.parametrize("write", [write_binary, write_text])
@pytest.mark.parametrize("where", ["sparse/0", "sparse", "colmap/sparse/0"])
def test_a_model_is_read_wherever_it_lies(tmp_path, write, where):
    write_images(tmp_path)
    write(tmp_path / where)
    capture = load_capture(tmp_path)
    assert capture.view_names == tuple(f"images/cam a/{number}.png" for number in range(4))
    for camera, pose in zip(capture.cameras, poses(4), strict=True):
        np.testing.assert_allclose(camera.world_from_cam.numpy(), pose, atol=1e-6)
        np.testing.assert_allclose(camera.focal_px.numpy(), LENS.focal_px, rtol=1e-6)
    assert (capture.has_ids, capture.has_depth, capture.metric) == (True, False, False)
    np.testing.assert_array_equal(capture[2].ids.numpy(), see(poses(4)[2]).ids)
    if write is write_binary:
        np.testing.assert_array_equal(capture.points.positions, [[1, 2, 3]])
        np.testing.assert_array_equal(capture.points.colours, [[10, 20, 30]])
    own = load_capture(tmp_path / where)  # the model's folder itself: images/ is found above it
    assert own.view_names == capture.view_names


def test_dense_depth_and_masks_belong_to_their_images(tmp_path):
    write_images(tmp_path)
    write_binary(tmp_path / "sparse" / "0")
    folder = tmp_path / "stereo" / "depth_maps" / "cam a"
    folder.mkdir(parents=True)
    for number, pose in enumerate(poses(4)):
        depth = see(pose).depth.astype("<f4")
        (folder / f"{number}.png.geometric.bin").write_bytes(b"64&48&1&" + depth.tobytes())
    mask = np.full((48, 64), 255, np.uint8)
    mask[:10] = 0
    write_png(tmp_path / "masks" / "cam a" / "1.png.png", mask)
    capture = load_capture(tmp_path)
    assert capture.has_metric_depth and not capture.metric  # z in the model's unit, which is no metre
    np.testing.assert_allclose(capture[0].depth.numpy(), see(poses(4)[0]).depth, rtol=1e-6)
    assert capture[1].valid.float().mean() == pytest.approx(38 / 48)
    assert capture[1].depth[:10].isnan().all()
    (folder / "0.png.geometric.bin").write_bytes(b"64&48&1&" + bytes(100))
    with pytest.raises(FileError, match=r"0\.png\.geometric\.bin: not one number for each of 64 x 48 pixels"):
        load_capture(tmp_path)[0]


def test_the_largest_of_several_models_is_taken_and_said(tmp_path):
    write_images(tmp_path)
    write_binary(tmp_path / "sparse" / "0", count=2)
    write_text(tmp_path / "sparse" / "1", count=4)
    heard = []
    assert len(load_capture(tmp_path, notify=heard.append)) == 4
    assert heard[0].message == "2 models: sparse/1 is read, which has 4 images (sparse/0: 2)"


@pytest.mark.parametrize(
    ("words", "fields"),
    [
        ("SIMPLE_PINHOLE 64 48 50 32 24", {}),
        ("SIMPLE_RADIAL 64 48 50 32 24 .1", {"radial": (0.1,)}),
        ("OPENCV 64 48 50 51 32 24 .1 .2 .3 .4", {"radial": (0.1, 0.2), "tangential": (0.3, 0.4)}),
        (
            "FULL_OPENCV 64 48 50 51 32 24 1 2 3 4 5 6 7 8",
            {"radial": (1, 2, 5), "tangential": (3, 4), "denominator": (6, 7, 8)},
        ),
        ("OPENCV_FISHEYE 64 48 50 51 32 24 1 2 3 4", {"projection": "fisheye", "radial": (1, 2, 3, 4)}),
        ("FOV 64 48 50 51 32 24 .9", {"projection": "fov", "shape": (0.9,)}),
        (
            "THIN_PRISM_FISHEYE 64 48 50 51 32 24 1 2 3 4 5 6 7 8",
            {"projection": "fisheye", "radial": (1, 2, 5, 6), "tangential": (3, 4), "prism": (7, 0, 8, 0)},
        ),
        (
            "RAD_TAN_THIN_PRISM_FISHEYE 64 48 50 51 32 24 0 1 2 3 4 5 6 7 8 9 10 11",
            {"radial": (0, 1, 2, 3, 4, 5), "tangential": (7, 6), "prism": (8, 9, 10, 11), "bent_twice": True},
        ),
        ("DIVISION 64 48 50 51 32 24 -.2", {"projection": "division", "shape": (-0.2,)}),
        ("EUCM 64 48 50 51 32 24 .6 1.1", {"projection": "eucm", "shape": (0.6, 1.1)}),
        ("EQUIRECTANGULAR 64 32 64 32", {"projection": "equirectangular", "width": 64}),
    ],
)
def test_parameters_of_models_are_where_colmap_has_them(tmp_path, words, fields):
    """Values of all models agree with pycolmap 4.2 to 1e-12 px (checked by hand); here, their places."""
    (tmp_path / "cameras.txt").write_text(f"1 {words}\n")
    lens = read_cameras(tmp_path / "cameras.txt")[1]
    assert {name: getattr(lens, name) for name in fields} == fields


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("cameras.bin", lambda data: data[:-3], "cameras.bin: damaged or cut short .*Copy it again"),
        ("images.bin", lambda data: data[:-9], "images.bin: damaged or cut short"),
        ("images.bin", lambda data: struct.pack("<Q", 2**60) + data[8:], "entries do not fit into the file"),
        ("points3D.bin", lambda data: data[:-16] + struct.pack("<QQ", 2**40, 0), "points3D.bin: damaged or cut short"),
        (
            "cameras.bin",
            lambda data: data[:12] + b"\x63" + data[13:],
            "camera 3 is of model 99, which goc",
        ),
        ("images.bin", lambda data: struct.pack("<Q", 0), "no image is registered"),
    ],
)
def test_damaged_models_are_one_error(tmp_path, name, change, message):
    write_images(tmp_path)
    model = write_binary(tmp_path / "sparse" / "0")
    (model / name).write_bytes(change((model / name).read_bytes()))
    with pytest.raises((CaptureError, FileError), match=message) as caught:
        load_capture(tmp_path)
    assert "\n" not in str(caught.value)


def test_what_a_model_names_must_be_there(tmp_path):
    write_images(tmp_path)
    model = write_binary(tmp_path / "sparse" / "0")
    (tmp_path / "images" / "cam a" / "2.png").unlink()
    with pytest.raises(CaptureError, match=r"1 of 4 images are missing \(first: images/cam a/2\.png\)"):
        load_capture(tmp_path)
    assert len(load_capture(tmp_path, CaptureConfig(allow_missing=True))) == 3
    (model / "cameras.bin").write_bytes(struct.pack("<Q", 0))
    with pytest.raises(CaptureError, match=r"4 of 4 images are of a camera that is not there .*cam a/0.*camera 7"):
        load_capture(tmp_path)
    with pytest.raises(CaptureError, match="sparse/ lacks cameras or images"):
        (model / "images.bin").unlink()
        load_capture(tmp_path)
