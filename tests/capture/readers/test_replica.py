"""Replica's rooms, in the packs of NICE-SLAM and vMAP."""

import json
from dataclasses import replace

import numpy as np
import pytest

from captures import LENS, write_nerfstudio
from goc.capture import CaptureConfig, load_capture
from goc.errors import CaptureError
from goc.files import write_png
from goc.synth.export import export_room
from roundtrips import assert_same_cameras, assert_same_frames


def test_the_pack_of_nice_slam(room, truth, tmp_path):
    export_room(room, "replica", tmp_path)
    capture = load_capture(tmp_path)
    assert_same_cameras(capture, truth)
    assert_same_frames(capture, truth, ids=False)
    assert (capture.metric, capture.view_names[10]) == (True, "results/frame000010.jpg")
    assert load_capture(tmp_path, CaptureConfig(every=5)).view_names[1] == "results/frame000005.jpg"


def test_the_pack_of_vmap(room, truth, tmp_path):
    export_room(room, "replica-vmap", tmp_path)
    capture = load_capture(tmp_path)
    assert_same_cameras(capture, truth)
    assert_same_frames(capture, truth)
    assert capture.view_names[10] == "rgb/rgb_10.png"
    assert capture.id_names == {1: "crate", 2: "cupboard"}


def test_ids_have_more_than_eight_bits(room, truth, tmp_path):
    export_room(room, "replica-vmap", tmp_path)
    ids = np.where(truth[0].ids.numpy() == 1, 700, 3)
    write_png(tmp_path / "semantic_instance/semantic_instance_0.png", ids.astype(np.uint16))
    assert set(load_capture(tmp_path)[0].ids.unique().tolist()) <= {0, 700}


def test_without_parameters_the_lens_is_that_of_the_rendering(tmp_path):
    lens = replace(LENS, focal_px=(32.0, 32.0), centre_px=(32.0, 24.0))
    room = write_nerfstudio(tmp_path / "native", 3, lens)
    truth = load_capture(room)
    export_room(room, "replica", tmp_path / "office0")
    (tmp_path / "office0/cam_params.json").unlink()
    assert_same_cameras(load_capture(tmp_path / "office0"), truth)


def test_parameters_may_lie_above_the_room(room, truth, tmp_path):
    export_room(room, "replica", tmp_path / "room0")
    file = tmp_path / "room0/cam_params.json"
    document = json.loads(file.read_text())
    document["camera"]["scale"] = 3276.75
    (tmp_path / "cam_params.json").write_text(json.dumps(document))
    file.unlink()
    capture = load_capture(tmp_path / "room0", CaptureConfig(checks="off"))
    assert_same_cameras(capture, truth)
    np.testing.assert_allclose(capture[0].depth, 2 * truth[0].depth, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("traj.txt", None, r"a Replica \(NICE-SLAM\) capture without traj\.txt\. Export or copy it again"),
        ("traj.txt", "1 0 0 0\n", r"traj\.txt: 4 numbers a line, not the 16"),
        ("traj.txt", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n", r"traj\.txt: 1 poses, but images up to number 11"),
        ("traj.txt", "2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n" * 12, "12 of 12 poses are not usable"),
        ("cam_params.json", '{"camera": {"w": 64}}', "missing required field"),
    ],
)
def test_what_is_wrong_is_said(room, truth, tmp_path, name, text, message):
    export_room(room, "replica", tmp_path)
    (tmp_path / name).unlink()
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(Exception, match=message) as caught:
        load_capture(tmp_path)
    assert str(caught.value).startswith(str(tmp_path))


def test_a_pack_without_images_is_told_so(room, truth, tmp_path):
    export_room(room, "replica-vmap", tmp_path)
    for file in (tmp_path / "rgb").iterdir():
        file.unlink()
    with pytest.raises(CaptureError, match=r"a Replica \(vMAP\) capture without images in rgb/"):
        load_capture(tmp_path)
