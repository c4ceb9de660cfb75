"""TUM RGB-D sequences: three streams, brought together by time."""

import numpy as np
import pytest

from goc.capture import CaptureConfig, load_capture
from goc.capture.readers import tum
from goc.errors import CaptureError, FileError
from goc.events import ignore
from goc.synth.export import export_room
from roundtrips import assert_same_cameras, assert_same_frames


@pytest.fixture
def folder(room, tmp_path):
    return export_room(room, "tum", tmp_path / "sequence")


def lens_of(folder):
    return tum.read(folder, CaptureConfig(), ignore).views[0].lens


def change(path, edit):
    lines = path.read_text().splitlines()
    path.write_text("\n".join(edit(lines)) + "\n")


def test_a_sequence_is_what_was_recorded(truth, folder):
    capture = load_capture(folder)
    assert_same_cameras(capture, truth)
    assert_same_frames(capture, truth, ids=False)
    assert capture.metric
    assert capture.view_names[1] == "rgb/1305031102.033333.png"


def test_poses_between_two_times_are_interpolated(truth, folder):
    """A walk along x and a turn about z, sampled at times that no image has."""
    rows = []
    for step in range(-2, 40):
        angle = 0.05 * step / 2
        numbers = (1305031102.0 + step * 0.01 - 0.003, 0.02 * step, 0, 0, 0, 0, np.sin(angle), np.cos(angle))
        rows.append(" ".join(f"{value:.9f}" for value in numbers))
    (folder / "groundtruth.txt").write_text("\n".join(rows))
    for number, camera in enumerate(load_capture(folder, CaptureConfig(checks="off")).cameras):
        steps = (number / 30 + 0.003) / 0.01
        assert camera.position[0].item() == pytest.approx(0.02 * steps, abs=1e-5)
        assert np.arctan2(*camera.world_from_cam[[1, 0], 0].tolist()) == pytest.approx(0.05 * steps, abs=1e-5)


def test_images_without_a_pose_or_depth_at_their_time(folder):
    change(folder / "groundtruth.txt", lambda lines: [*lines[:3], *lines[5:]])
    change(folder / "depth.txt", lambda lines: lines[:-1])
    heard = []
    capture = load_capture(folder, CaptureConfig(checks="off"), heard.append)
    assert len(capture) == 10
    assert [event.message for event in heard] == [
        "2 of 12 images have no pose at their time and are left out (first: rgb/1305031102.066667.png)",
        "1 of 10 views have no depth images",
    ]
    assert capture[9].depth is None


def test_the_cameras_of_the_data_set_are_known_by_the_name_of_the_folder(folder):
    (folder / "calibration.txt").unlink()
    with pytest.raises(CaptureError, match=r"no intrinsics, .* freiburg1 to 3\. Add calibration\.txt with fx fy cx cy"):
        load_capture(folder)
    lens = lens_of(folder.rename(folder.with_name("rgbd_dataset_freiburg3_office")))
    assert (lens.width, lens.focal_px, lens.centre_px) == (640, (535.4, 539.2), (320.6, 248.1))


def test_five_numbers_of_distortion_have_the_order_of_opencv(folder):
    change(folder / "calibration.txt", lambda lines: [lines[0] + " 0.02 -0.01 0.001 0.002 0.003"])
    lens = lens_of(folder)
    assert (lens.radial[:3], lens.tangential) == ((0.02, -0.01, 0.003), (0.001, 0.002))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("groundtruth.txt", None, r"a TUM RGB-D capture without groundtruth\.txt"),
        ("groundtruth.txt", "1 2 3\n", r"groundtruth\.txt: expected lines of time, position and quaternion"),
        ("groundtruth.txt", "5 0 0 0 0 0 0 1\n", r"no image has a pose within 0\.02 s \(first: rgb/"),
        ("groundtruth.txt", "5 nan 0 0 0 0 0 1\n", "holds no pose that is finite"),
        ("rgb.txt", "1305031102.0\n", r"rgb\.txt: entry 1 is not a time and a file"),
        ("calibration.txt", "500 500\n", "expected fx fy cx cy"),
    ],
)
def test_what_is_wrong_is_said(folder, name, text, message):
    (folder / name).unlink()
    if text is not None:
        (folder / name).write_text(text)
    with pytest.raises((CaptureError, FileError), match=message):
        load_capture(folder)
