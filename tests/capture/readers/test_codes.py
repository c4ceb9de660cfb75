"""Captures that research codes train on: MonoSDF's family, HoloScene, Gaussian Grouping."""

import io
import json

import numpy as np
import pytest

from goc.capture import load_capture
from goc.errors import CaptureError, FileError
from goc.files import write_png
from goc.synth.export import export_room
from roundtrips import assert_same_cameras, assert_same_frames


@pytest.fixture
def scene(room, tmp_path):
    return export_room(room, "monosdf", tmp_path / "scan1")


def rewrite(path, edit):
    arrays = dict(np.load(path))
    edit(arrays)
    archive = io.BytesIO()
    np.savez(archive, **arrays)
    path.write_bytes(archive.getvalue())


def test_poses_are_metric_whatever_the_normalisation(truth, scene):
    def edit(arrays):
        for name in list(arrays):
            if name.startswith("scale_mat"):
                arrays[name] = np.diag([7.0, 7, 7, 1])
            else:
                arrays[name] = arrays[name] * 3.0  # a projection is known to a factor

    rewrite(scene / "cameras.npz", edit)
    capture = load_capture(scene)
    assert_same_cameras(capture, truth)
    assert_same_frames(capture, truth)
    assert (capture.metric, capture.units_per_metre, capture.depth_kind) == (True, 1.0, "affine")
    assert capture.id_names == {1: "crate", 2: "cupboard"}
    normals = capture[0].normals
    assert ((normals * capture.cameras[0].rays()).sum(-1)[~normals.isnan().any(-1)] < 0).all()


def test_intrinsics_from_before_a_crop_are_brought_along(truth, scene):
    """Images of 64 x 48 were the middle of 160 x 120, whose middle 128 x 96 was kept and halved: K is of the former."""

    def edit(arrays):
        for name in [name for name in arrays if name.startswith("world_mat")]:
            pose = np.linalg.inv(K) @ arrays[name][:3]
            arrays[name][:3] = np.array([[100.0, 0, 149.5], [0, 100, 119.5], [0, 0, 1]]) @ pose

    K = np.array([[50.0, 0, 30.5], [0, 51, 24], [0, 0, 1]])
    rewrite(scene / "cameras.npz", edit)
    heard = []
    camera = load_capture(scene, notify=heard.append).cameras[0]
    scale = 64 / 300  # of 300 x 240, the middle 300 x 225
    np.testing.assert_allclose(camera.focal_px, 100 * scale, rtol=1e-6)
    np.testing.assert_allclose(camera.centre_px, (32, 24), rtol=1e-6)
    np.testing.assert_allclose(camera.world_from_cam, truth.cameras[0].world_from_cam, atol=1e-5)
    assert "cropped about their middle" in heard[0].message


def test_ids_of_objectsdf_plus(truth, scene):
    """Raw 7 and 9 are objects, 3 and 4 are walls; what is not in the mapping is unlabelled."""
    (scene / "instance_id.json").unlink()
    for file in (scene / "instance_mask").iterdir():
        file.unlink()
    (scene / "instance_mapping.txt").write_text("3,1,0\n4,2,0\n7,5,1\n9,5,2\n")
    for number, frame in enumerate(truth):
        raw = np.array([3, 7, 9], np.uint8)[frame.ids.numpy()]
        raw[0, :8], raw[1, :8] = 4, 200
        write_png(scene / f"segs/{number:06}_segs.png", raw)
    ids = load_capture(scene)[0].ids.numpy()
    wanted = np.array([0, 7, 9])[truth[0].ids.numpy()]
    wanted[0, :8], wanted[1, :8] = 0, -1
    np.testing.assert_array_equal(ids, wanted)


def test_an_object_may_have_the_value_0(truth, scene):
    (scene / "instance_id.json").write_text(json.dumps({"crate": 0, "cupboard": 2}))
    for number, frame in enumerate(truth):
        write_png(scene / f"instance_mask/{number:06}.png", np.array([255, 0, 2], np.uint8)[frame.ids.numpy()])
    capture = load_capture(scene)
    assert capture.id_names == {3: "crate", 2: "cupboard"}
    np.testing.assert_array_equal(capture[0].ids, np.array([0, 3, 2])[truth[0].ids.numpy()])


def test_depth_that_is_masked_is_none(scene):
    mask = np.ones((1, 48, 64), np.float32)
    mask[:, :10] = 0
    np.save(scene / "000000_mask.npy", mask)
    depth = load_capture(scene)[0].depth
    assert depth[:10].isnan().all() and not depth[10:].isnan().any()


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda arrays: arrays.clear(), "holds no world_mat_0"),
        (lambda arrays: arrays.pop("world_mat_3"), r"1 of 12 images have no world_mat \(first: 000003_rgb\.png\)"),
        (lambda arrays: arrays.update(world_mat_3=np.zeros((4, 4))), "world_mat_3 is no product of intrinsics"),
        (
            lambda arrays: arrays.update(world_mat_3=arrays["world_mat_3"] @ np.diag([2.0, 1, 1, 1])),
            "world_mat_3 has skewed pixels",
        ),
        (lambda arrays: arrays.update(world_mat_3=np.array([None])), r"cameras\.npz: not a readable \.npz file"),
    ],
)
def test_cameras_that_make_no_sense(scene, edit, message):
    rewrite(scene / "cameras.npz", edit)
    with pytest.raises((CaptureError, FileError), match=message) as caught:
        load_capture(scene)
    assert "\n" not in str(caught.value)


def test_a_scene_without_cameras_is_told_so(scene):
    (scene / "cameras.npz").unlink()
    with pytest.raises(CaptureError, match=r"a MonoSDF capture without cameras\.npz\. Export or copy it again"):
        load_capture(scene)


def test_holoscene(room, truth, tmp_path):
    export_room(room, "holoscene", tmp_path)
    capture = load_capture(tmp_path)
    assert_same_cameras(capture, truth)
    assert_same_frames(capture, truth)
    assert (capture.depth_kind, capture.metric) == ("affine", False)
    (tmp_path / "instance_mask/0005.png").unlink()
    with pytest.raises(
        CaptureError, match=r"instance_mask: 11 files for the 12 of images/, which they follow by order"
    ):
        load_capture(tmp_path)


def test_holoscene_pairs_files_of_other_names_by_order(room, truth, tmp_path):
    export_room(room, "holoscene", tmp_path)
    for number, file in enumerate(sorted((tmp_path / "instance_mask").iterdir())):
        file.rename(file.with_name(f"mask_{number:03}.png"))
    assert_same_frames(load_capture(tmp_path), truth)


def test_gaussian_grouping(room, truth, tmp_path):
    export_room(room, "gaussian-grouping", tmp_path)
    assert_same_frames(load_capture(tmp_path), truth, depth=False)
