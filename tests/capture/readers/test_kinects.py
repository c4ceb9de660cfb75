"""7-Scenes and BOP."""

import json
from dataclasses import replace

import numpy as np
import pytest

from captures import poses, see
from goc.capture import load_capture
from goc.capture.source import Lens
from goc.errors import CaptureError, FileError
from goc.files import write_depth, write_png
from goc.synth.export import export_room
from roundtrips import assert_same_cameras, assert_same_frames


def write_kinect(folder, views=3):
    """What a Kinect's two cameras see, each from its own place: colour 25 mm to the right, with a shorter lens."""
    depth_lens = Lens(128, 96, (117.0, 117.0), (64.1, 48.1))
    colour_lens = replace(depth_lens, focal_px=(105.0, 105.0))
    shots = []
    for number, pose in enumerate(poses(views)):
        moved = pose.copy()
        moved[:3, 3] += 0.025 * pose[:3, 0]
        shots.append(see(moved, colour_lens))
        stem = folder / f"frame-{number:06}"
        write_png(stem.with_name(f"{stem.name}.color.png"), shots[-1].image)
        write_depth(stem.with_name(f"{stem.name}.depth.png"), see(pose, depth_lens).depth)
        np.savetxt(stem.with_name(f"{stem.name}.pose.txt"), pose)
    return shots


def test_depth_of_7_scenes_is_seen_from_where_colour_was(tmp_path):
    shots = write_kinect(tmp_path)
    capture = load_capture(tmp_path)
    for shot, frame, pose in zip(shots, capture, poses(3), strict=True):
        np.testing.assert_allclose(frame.camera.position, pose[:3, 3] + 0.025 * pose[:3, 0], atol=1e-6)
        assert frame.depth.isnan().float().mean() < 0.25  # depth has the narrower lens
        error = np.abs(frame.depth.numpy() - shot.depth)
        assert np.nanmedian(error) < 0.015  # half a pixel on slanted surfaces
        assert (error[~np.isnan(error)] < 0.05).mean() > 0.9


def test_intrinsics_written_for_depth_alone_are_known(tmp_path):
    shots = write_kinect(tmp_path, views=1)
    np.savetxt(tmp_path / "camera-intrinsics.txt", [[585, 0, 320], [0, 585, 240], [0, 0, 1]])
    frame = load_capture(tmp_path)[0]
    assert np.nanmedian(np.abs(frame.depth.numpy() - shots[0].depth)) < 0.015


def test_registered_scenes_of_the_layout(room, truth, tmp_path):
    export_room(room, "7-scenes", tmp_path / "scene")
    for path in (tmp_path / "scene", tmp_path / "scene/seq-01"):
        capture = load_capture(path)
        assert_same_cameras(capture, truth)
        assert_same_frames(capture, truth, ids=False)


def test_several_sequences_are_one_capture(room, tmp_path):
    export_room(room, "7-scenes", tmp_path)
    (tmp_path / "seq-02").mkdir()
    for file in (tmp_path / "seq-01").glob("frame-00000[0-3].*"):
        file.rename(tmp_path / "seq-02" / file.name)
    names = load_capture(tmp_path).view_names
    assert (len(names), names[0], names[-1]) == (
        12,
        "seq-01/frame-000004.color.png",
        "seq-02/frame-000003.color.png",
    )


@pytest.mark.parametrize(
    ("gone", "message"),
    [
        ("*.pose.txt", r"a 7-Scenes capture without frame-000000\.pose\.txt"),
        ("*.color.png", r"without frame-\*\.color"),
    ],
)
def test_sequences_that_are_not_whole(room, tmp_path, gone, message):
    export_room(room, "7-scenes", tmp_path)
    for file in (tmp_path / "seq-01").glob(gone):
        file.unlink()
    with pytest.raises(CaptureError, match=message):
        load_capture(tmp_path)


@pytest.fixture
def scene(room, tmp_path):
    return export_room(room, "bop", tmp_path / "000001")


def change(path, edit):
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))


def test_bop(truth, scene):
    capture = load_capture(scene)
    assert_same_cameras(capture, truth)
    assert_same_frames(capture, truth)
    assert capture.metric


def test_bop_steps_of_depth_differ_by_image(truth, scene):
    change(scene / "scene_camera.json", lambda document: document["1"].update(depth_scale=0.5))
    capture = load_capture(scene)
    np.testing.assert_allclose(capture[1].depth, truth[1].depth / 2, atol=1e-3)
    np.testing.assert_allclose(capture[2].depth, truth[2].depth, atol=1e-3)


def test_two_instances_of_an_object_are_told_apart_by_place(truth, scene):
    def edit(document):
        for entries in document.values():
            for entry in entries:
                entry["obj_id"] = 9
            entries.reverse()  # their order says nothing

    masks = sorted((scene / "mask_visib").glob("*_000000.png"))
    for first in masks:
        second = first.with_name(first.name.replace("_000000.png", "_000001.png"))
        if second.exists():
            first.rename(first.with_suffix(".tmp"))
            second.rename(first)
            first.with_suffix(".tmp").rename(second)
    change(scene / "scene_gt.json", edit)
    capture = load_capture(scene)
    ids = {number: set() for number in (1, 2)}
    for frame, exact in zip(capture, truth, strict=True):
        for number, found in ids.items():
            found.update(frame.ids[exact.ids == number].unique().tolist())
    assert sorted(map(sorted, ids.values())) == [[1], [2]]
    assert capture.id_names == {1: "object 9", 2: "object 9"}


def test_an_object_that_lies_still_stands_for_the_world(truth, scene):
    def edit(document):
        for camera in document.values():
            del camera["cam_R_w2c"], camera["cam_t_w2c"]

    change(scene / "scene_camera.json", edit)
    heard = []
    capture = load_capture(scene, notify=heard.append)
    shift = np.eye(4)
    shift[0, 3] = -1.0  # the exporter's models stand along x
    assert_same_cameras(capture, truth, shift)
    assert "object 1, if it lies still, is the world" in heard[0].message
    change(scene / "scene_gt.json", lambda document: document["3"].clear())
    with pytest.raises(CaptureError, match="nothing tells where the cameras stood"):
        load_capture(scene)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda document: document.pop("3"), r"1 of 12 images have no camera \(first: 000003\.jpg\)"),
        (lambda document: document["3"].update(cam_K=[1.0]), "cam_K or depth_scale of 3 make no sense"),
        (lambda document: document["3"].update(cam_R_w2c=[2.0] * 9), "1 of 12 poses are not usable"),
        (lambda document: document["3"].pop("cam_K"), "missing required field `cam_K`"),
    ],
)
def test_cameras_of_bop_that_make_no_sense(scene, edit, message):
    change(scene / "scene_camera.json", edit)
    with pytest.raises((CaptureError, FileError), match=message):
        load_capture(scene)
