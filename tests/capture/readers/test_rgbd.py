import json

import numpy as np
import pytest
import torch

from captures import LENS, poses, see, write_rgbd
from fuzz import mutants
from goc.capture import CaptureConfig, load_capture
from goc.errors import CaptureError, FileError
from goc.files import write_ids


def test_every_view_is_what_its_camera_sees(tmp_path):
    capture = load_capture(write_rgbd(tmp_path))
    assert len(capture) == 6
    assert capture.view_names[2] == "color/0002.jpg"
    assert (capture.has_depth, capture.has_ids, capture.metric, capture.units_per_metre) == (True, True, True, 1.0)
    assert capture.id_names == {1: "crate", 2: "cupboard"}
    np.testing.assert_allclose(capture.cameras[0].centre_px, LENS.centre_px)
    for pose, frame in zip(poses(), capture, strict=True):
        shot = see(pose)
        torch.testing.assert_close(frame.camera.world_from_cam, torch.tensor(pose, dtype=torch.float32))
        assert np.median(np.abs(frame.image.numpy().astype(int) - shot.image)) <= 2  # JPEG
        np.testing.assert_array_equal(frame.ids, shot.ids)
        np.testing.assert_allclose(frame.depth, shot.depth, atol=0.0006)


@pytest.mark.parametrize("size", [3, 4])
def test_a_matrix_stands_in_for_meta(tmp_path, size):
    write_rgbd(tmp_path, views=1)
    (tmp_path / "meta.json").unlink()
    matrix = np.eye(size)
    matrix[:3, :3] = [[50, 0, 30.5], [0, 51, 24], [0, 0, 1]]
    np.savetxt(tmp_path / "intrinsics.txt", matrix)
    camera = load_capture(tmp_path).cameras[0]
    assert camera.focal_px.tolist() == [50, 51]
    assert camera.centre_px.tolist() == [31, 24.5]
    assert (camera.width, camera.height) == (64, 48)


def test_codes_of_ids_are_understood(tmp_path):
    """Background 9 is the room, 200 is unknown, and of the rest only 7 means something."""

    def change(meta):
        meta |= {"instance_background": 9, "instance_unknown": 200, "mask_values": [9, 7]}

    write_rgbd(tmp_path, views=1, change=change)
    (tmp_path / "instance").rename(tmp_path / "mask")
    stored = np.zeros((48, 64), np.int16)
    stored[0], stored[1], stored[2], stored[3] = 9, 200, 7, -1
    write_ids(tmp_path / "mask/0000.png", stored)
    ids = load_capture(tmp_path)[0].ids
    assert [ids[row, 0].item() for row in range(5)] == [0, -1, 7, -1, -1]


def test_a_folder_without_depth_is_not_metric(tmp_path):
    write_rgbd(tmp_path)
    for file in (tmp_path / "depth").iterdir():
        file.unlink()
    (tmp_path / "depth").rmdir()
    capture = load_capture(tmp_path)
    assert not capture.has_depth
    assert not capture.metric
    assert capture[0].depth is None


def test_views_without_a_pose_can_be_left_out(tmp_path):
    write_rgbd(tmp_path)
    (tmp_path / "pose/0002.txt").unlink()
    (tmp_path / "color/0004.jpg").unlink()
    heard = []
    capture = load_capture(tmp_path, CaptureConfig(allow_missing=True), heard.append)
    assert capture.view_names == tuple(f"color/{number:04d}.jpg" for number in (0, 1, 3, 5))
    assert [event.message for event in heard] == [
        "1 of 5 color images have no pose and are left out (first: 0002.jpg)",
        "1 poses have no color image and are not used (first: 0004.txt)",
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.update(fx=0), r"meta\.json: width 64, height 48, fx 0, fy 51\. All four must be positive"),
        (lambda m: m.update(width=-3), "width -3"),
        (lambda m: m.update(cy=700), "the principal point 30.5, 700 is outside the image of 64 x 48"),
        (lambda m: m.pop("fx"), "missing required field `fx`"),
        (lambda m: m.update(depth_scale=0), "depth_scale is 0"),
        (lambda m: m.update(camera_convention="OpenGL"), "camera_convention is 'OpenGL'. Write poses with OpenCV axes"),
        (
            lambda m: m.update(width=640, height=480),
            r"2 of 2 images are not of the size of their intrinsics \(first: color/0000",
        ),
        (lambda m: m.update(instances={"one": "x"}), r"1 of 1 names belong to no id \(first: 'one'\)"),
    ],
)
def test_a_malformed_meta_is_one_error(tmp_path, change, message):
    write_rgbd(tmp_path, views=2, change=change)
    with pytest.raises((CaptureError, FileError), match=message) as caught:
        load_capture(tmp_path)
    assert str(caught.value).startswith(str(tmp_path))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "1 0 0\n0 1 0\n0 0 1\n",
            r"pose: 1 of 2 poses are not usable \(first: 0001\.txt: expected 4 x 4 numbers, found 3 rows of",
        ),
        ("2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", r"0001\.txt: its axes, of lengths 2 1 1"),
        ("nan 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", r"pose/0001\.txt: 1 numbers are not finite"),
        ("", r"pose/0001\.txt: expected a matrix, found nothing"),
    ],
)
def test_a_malformed_pose_is_one_error(tmp_path, text, message):
    write_rgbd(tmp_path, views=2)
    (tmp_path / "pose/0001.txt").write_text(text)
    with pytest.raises(CaptureError, match=message):
        load_capture(tmp_path)


def test_views_without_a_finite_pose_are_left_out_and_counted(tmp_path):
    write_rgbd(tmp_path, views=3)
    (tmp_path / "pose/0001.txt").write_text("-inf " * 16)
    heard = []
    assert load_capture(tmp_path, notify=heard.append).view_names == ("color/0000.jpg", "color/0002.jpg")
    assert any("1 of 3 views have no finite pose and are left out (first: 0001.jpg)" in e.message for e in heard)


def test_missing_files_are_counted(tmp_path):
    write_rgbd(tmp_path, views=3)
    (tmp_path / "depth/0001.png").unlink()
    with pytest.raises(
        CaptureError, match=r"1 of 3 depth images are missing \(first: color/0001\.jpg\)\. .*allow-missing"
    ):
        load_capture(tmp_path)
    (tmp_path / "pose/0002.txt").unlink()
    with pytest.raises(CaptureError, match=r"1 of 3 color images have no pose \(first: 0002\.jpg\)\. .*allow-missing"):
        load_capture(tmp_path)
    for file in (tmp_path / "pose").iterdir():
        file.unlink()
    with pytest.raises(CaptureError, match="3 of 3 color images have no pose"):
        load_capture(tmp_path, CaptureConfig(allow_missing=True))
    for file in (tmp_path / "color").iterdir():
        file.unlink()
    with pytest.raises(CaptureError, match=r"color: holds no \.jpg, \.jpeg, \.png images"):
        load_capture(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, r"no intrinsics\. Add meta\.json"),
        ("1 2\n3 4\n", r"intrinsics\.txt: expected 3 x 3 or 4 x 4 numbers, found 2 x 2"),
        ("50 1 30\n0 51 24\n0 0 1\n", r"intrinsics\.txt: not of the form fx 0 cx"),
        ("0 0 30\n0 51 24\n0 0 1\n", r"intrinsics\.txt: width 64, height 48, fx 0"),
    ],
)
def test_intrinsics_that_make_no_sense_are_refused(tmp_path, text, message):
    write_rgbd(tmp_path, views=1)
    (tmp_path / "meta.json").unlink()
    if text is not None:
        (tmp_path / "intrinsics.txt").write_text(text)
    with pytest.raises(CaptureError, match=message):
        load_capture(tmp_path)


def test_damaged_meta_and_poses_raise_only_our_errors(tmp_path):
    write_rgbd(tmp_path, views=2)
    for name in ("meta.json", "pose/0001.txt"):
        good = (tmp_path / name).read_bytes()
        for mutant in mutants(good, 200, seed=1):
            (tmp_path / name).write_bytes(mutant)
            try:
                load_capture(tmp_path, CaptureConfig(checks="off"))
            except (CaptureError, FileError) as error:
                assert str(tmp_path) in str(error)
                assert "\n" not in str(error)
        (tmp_path / name).write_bytes(good)
    assert json.loads((tmp_path / "meta.json").read_text())
