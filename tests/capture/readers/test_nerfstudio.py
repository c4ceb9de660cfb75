import json
import math

import numpy as np
import pytest
import torch
from PIL import Image

import captures
from captures import BENT, LENS, corners, poses, see, write_nerfstudio
from fuzz import mutants
from goc.capture import CaptureConfig, load_capture
from goc.capture.intrinsics import Intrinsics
from goc.capture.intrinsics import lens_of as lens_of_intrinsics
from goc.capture.source import Lens
from goc.errors import CaptureError, FileError
from goc.files import write_depth, write_ids, write_ply, write_png
from goc.geometry.normals import normals_from_depth
from goc.scene import UNLABELLED

UNCHECKED = CaptureConfig(checks="off")
"""For captures whose numbers contradict each other on purpose, or are damaged after loading."""


def edit(folder, change):
    document = json.loads((folder / "transforms.json").read_text())
    change(document)
    (folder / "transforms.json").write_text(json.dumps(document))


def without(*names):
    def change(document):
        for name in names:
            document.pop(name)

    return change


def lens_of(camera):
    return Lens(camera.width, camera.height, tuple(camera.focal_px.tolist()), tuple(camera.centre_px.tolist()))


def test_every_view_is_what_its_camera_sees(tmp_path):
    capture = load_capture(write_nerfstudio(tmp_path))
    assert len(capture) == 6
    assert capture.view_names[2] == "images/0002.png"
    assert (capture.has_depth, capture.has_ids, capture.metric, capture.units_per_metre) == (True, True, True, 1.0)
    assert capture.id_names == {0: "room", 1: "crate", 2: "cupboard"}
    np.testing.assert_array_equal(capture.points.positions, corners().positions)
    for pose, frame in zip(poses(), capture, strict=True):
        shot = see(pose)
        torch.testing.assert_close(frame.camera.world_from_cam, torch.tensor(pose, dtype=torch.float32))
        np.testing.assert_array_equal(frame.image, shot.image)
        np.testing.assert_array_equal(frame.ids, shot.ids)
        np.testing.assert_allclose(frame.depth, shot.depth, atol=0.0006)  # stored in millimetres


def test_distortion_is_undone(tmp_path):
    """Twin: what a pinhole with the decoded camera sees; the stored images were cast through the bent lens."""
    capture = load_capture(write_nerfstudio(tmp_path, lens=BENT))
    for pose, frame in zip(poses(), capture, strict=True):
        shot = see(pose, lens_of(frame.camera))
        left_bent = see(pose, BENT).image[: frame.camera.height, : frame.camera.width]
        smooth = _away_from_edges(shot.ids)
        errors = np.abs(frame.image.numpy().astype(int) - shot.image).max(-1)
        assert np.quantile(errors[smooth], 0.98) <= 3  # the room's own edges are not in ids
        assert np.quantile(np.abs(left_bent.astype(int) - shot.image).max(-1)[smooth], 0.98) > 15
        np.testing.assert_array_equal(frame.ids.numpy()[smooth], shot.ids[smooth])
        assert np.median(np.abs(frame.depth.numpy() - shot.depth)) < 0.02  # nearest pixel


def test_undistorting_keeps_the_focal_and_leaves_no_black_frame(tmp_path):
    camera = load_capture(write_nerfstudio(tmp_path, views=1, lens=BENT)).cameras[0]
    np.testing.assert_allclose(camera.focal_px, BENT.focal_px)
    assert 0.8 * BENT.width < camera.width < BENT.width
    assert 0.8 * BENT.height < camera.height < BENT.height


def _away_from_edges(ids):
    """Pixels whose neighbours, two away, have the same id."""
    flat = np.ones(ids.shape, bool)
    for shift in (-2, -1, 1, 2):
        for axis in (0, 1):
            flat &= np.roll(ids, shift, axis) == ids
    flat[:2], flat[-2:], flat[:, :2], flat[:, -2:] = False, False, False, False
    return flat


def test_a_barrel_lens_loses_no_pixel(tmp_path):
    barrel = Lens(64, 48, (50.0, 51.0), (31.0, 24.5), radial=(-0.05, 0.0, 0.0, 0.0))
    camera = load_capture(write_nerfstudio(tmp_path, views=1, lens=barrel)).cameras[0]
    assert (camera.width, camera.height) == (64, 48)


def test_a_file_of_another_name_picks_its_subset(tmp_path):
    folder = write_nerfstudio(tmp_path)
    document = json.loads((folder / "transforms.json").read_text())
    document["frames"] = document["frames"][::3]
    (folder / "transforms_sparse.json").write_text(json.dumps(document))
    capture = load_capture(folder / "transforms_sparse.json")
    assert capture.view_names == ("images/0000.png", "images/0003.png")
    assert capture.id_names[1] == "crate"


def test_intrinsics_of_a_frame_win_over_shared_ones(tmp_path):
    def change(document):
        document["frames"][1] |= {"fl_x": 40.0, "fl_y": 41.0, "cx": 30.0}

    cameras = load_capture(write_nerfstudio(tmp_path, views=2, change=change), UNCHECKED).cameras
    assert cameras[0].focal_px.tolist() == [50.0, 51.0]
    assert cameras[1].focal_px.tolist() == [40.0, 41.0]
    assert cameras[1].centre_px.tolist() == [30.0, 24.5]


def test_an_angle_of_view_stands_in_for_everything(tmp_path):
    """The oldest files: no size, no focal, no principal point, no suffix."""

    def change(document):
        without("camera_model", "w", "h", "fl_x", "fl_y", "cx", "cy", "depth_unit_scale_factor", "ply_file_path")(
            document
        )
        document["camera_angle_x"] = math.pi / 2
        for frame in document["frames"]:
            frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")

    capture = load_capture(write_nerfstudio(tmp_path, views=2, change=change), UNCHECKED)
    camera = capture.cameras[0]
    assert (camera.width, camera.height) == (64, 48)
    np.testing.assert_allclose(camera.focal_px, [32, 32], rtol=1e-6)
    assert camera.centre_px.tolist() == [32, 24]
    assert capture.view_names[0] == "images/0000"
    assert capture[0].image.shape == (48, 64, 3)
    assert capture.points is None


def test_sizes_may_be_written_as_floats(tmp_path):
    capture = load_capture(write_nerfstudio(tmp_path, views=1, change=lambda document: document.update(w=64.0, h=48.0)))
    assert capture.cameras[0].width == 64


@pytest.mark.parametrize("folder", ["instance", "instance_mask", "object_mask"])
def test_ids_are_found_in_a_sibling_folder(tmp_path, folder):
    def change(document):
        for frame in document["frames"]:
            frame.pop("instance_file_path")

    write_nerfstudio(tmp_path, views=2, change=change)
    (tmp_path / "instance").rename(tmp_path / folder)
    capture = load_capture(tmp_path)
    assert capture.has_ids
    np.testing.assert_array_equal(capture[1].ids, see(poses(2)[1]).ids)


def test_255_is_unlabelled(tmp_path):
    write_nerfstudio(tmp_path, views=1)
    ids = np.zeros((48, 64), np.int16)
    ids[0], ids[1] = -1, 7
    write_ids(tmp_path / "instance/0000.png", ids)
    np.testing.assert_array_equal(load_capture(tmp_path)[0].ids, ids)


def test_depth_in_another_unit_and_without_a_measurement(tmp_path):
    write_nerfstudio(tmp_path, views=1, change=lambda document: document.update(depth_unit_scale_factor=0.0005))
    depth = see(poses(1)[0]).depth
    depth[:5] = np.nan
    write_depth(tmp_path / "depth/0000.png", depth)
    np.testing.assert_allclose(load_capture(tmp_path)[0].depth, depth / 2, atol=0.0006)


def test_depth_of_lower_resolution_is_spread(tmp_path):
    write_nerfstudio(tmp_path, views=1)
    coarse = see(poses(1)[0], Lens(32, 24, (25.0, 25.5), (15.5, 12.25)))
    write_depth(tmp_path / "depth/0000.png", coarse.depth)
    frame = load_capture(tmp_path)[0]
    assert np.median(np.abs(frame.depth.numpy() - see(poses(1)[0]).depth)) < 0.02


def test_views_are_scaled_down(tmp_path):
    frame = load_capture(write_nerfstudio(tmp_path, views=1), CaptureConfig(max_side_px=32))[0]
    shot = see(poses(1)[0], lens_of(frame.camera))
    assert frame.image.shape == (24, 32, 3)
    smooth = _away_from_edges(shot.ids)
    assert np.median(np.abs(frame.image.numpy().astype(int) - shot.image)[smooth]) <= 2
    np.testing.assert_array_equal(frame.ids.numpy()[smooth], shot.ids[smooth])
    assert np.median(np.abs(frame.depth.numpy() - shot.depth)) < 0.03


def test_given_ids_and_depth_can_be_ignored(tmp_path):
    write_nerfstudio(tmp_path, views=2)
    capture = load_capture(tmp_path, CaptureConfig(use_ids=False, use_depth=False))
    assert not capture.has_ids
    assert not capture.has_depth
    assert capture[0].ids is None
    assert capture[0].depth is None
    assert capture.id_names == {}
    assert capture.metric  # the poses are in the depth's unit all the same


def test_missing_images_can_be_left_out(tmp_path):
    write_nerfstudio(tmp_path)
    (tmp_path / "images/0001.png").unlink()
    (tmp_path / "depth/0003.png").unlink()
    heard = []
    capture = load_capture(tmp_path, CaptureConfig(allow_missing=True), heard.append)
    assert len(capture) == 5
    assert [frame.depth is None for frame in capture] == [False, False, True, False, False]
    messages = [event.message for event in heard]
    assert "1 of 6 images are missing and left out (first: images/0001.png)" in messages
    assert "1 of 5 views have no depth images" in messages


@pytest.mark.parametrize("lens", [captures.LENS, BENT])
def test_normals_are_what_each_camera_sees(tmp_path, lens):
    """Twin: normals of the boxes' true depth through a pinhole of the decoded camera."""
    capture = load_capture(captures.with_normals(write_nerfstudio(tmp_path, lens=lens), lens))
    for pose, frame in zip(poses(), capture, strict=True):
        shot = see(pose, lens_of(frame.camera))
        truth = normals_from_depth(torch.from_numpy(shot.depth).float(), frame.camera)
        cosine = (truth * frame.normals).sum(-1).numpy()[_away_from_edges(shot.ids)]
        assert np.nanquantile(cosine, 0.1) > 0.999
        torch.testing.assert_close(frame.normals.norm(dim=-1).nan_to_num(1.0), torch.ones(shot.ids.shape))


def test_normals_of_single_views_may_be_missing(tmp_path):
    captures.with_normals(write_nerfstudio(tmp_path, views=3))
    edit(tmp_path, lambda document: document["frames"][0].pop("normal_file_path"))
    heard = []
    capture = load_capture(tmp_path, notify=heard.append)
    assert [frame.normals is None for frame in capture] == [True, False, False]
    assert [event.message for event in heard] == ["1 of 3 views have no normal images"]
    (tmp_path / "normals/0002.png").unlink()
    with pytest.raises(CaptureError, match=r"1 of 2 normal images are missing .*no-use-normals"):
        load_capture(tmp_path)
    capture = load_capture(tmp_path, CaptureConfig(allow_missing=True))
    assert [frame.normals is None for frame in capture] == [True, False, True]
    assert load_capture(tmp_path, CaptureConfig(use_normals=False))[1].normals is None


def test_normals_of_opengl_axes_are_refused(tmp_path):
    captures.with_normals(write_nerfstudio(tmp_path, views=1), turn=(1.0, -1.0, -1.0))
    with pytest.raises(CaptureError, match=r"normals/0000\.png: most normals look away .* negate y and z"):
        load_capture(tmp_path)[0]


@pytest.mark.parametrize("kind", ["affine", "inverse"])
def test_monocular_depth_is_kept_as_stored_and_measures_nothing(tmp_path, kind):
    write_nerfstudio(tmp_path, change=lambda document: document.update(depth_kind=kind))
    capture = load_capture(tmp_path)
    assert (capture.has_depth, capture.has_metric_depth, capture.depth_kind) == (True, False, kind)
    assert not capture.metric and capture.units_per_metre != 1.0  # guessed, as without depth
    np.testing.assert_allclose(capture[0].depth, see(poses()[0]).depth, atol=0.0006)
    known = load_capture(tmp_path, CaptureConfig(depth_kind="metric"))
    assert known.has_metric_depth and known.metric and known.units_per_metre == 1.0
    edit(tmp_path, lambda document: document.update(depth_kind="disparity"))
    with pytest.raises(FileError, match="Invalid enum value 'disparity'"):
        load_capture(tmp_path)


def test_a_mask_takes_colour_depth_and_ids_away(tmp_path):
    def change(document):
        document["frames"][0]["mask_path"] = "masks/0.png"

    write_nerfstudio(tmp_path, views=2, change=change)
    plain = np.full((24, 32), 255, np.uint8)  # half the size of the images
    plain[:, :8] = 0
    write_png(tmp_path / "masks" / "0.png", plain)
    masked, whole = load_capture(tmp_path)
    assert whole.valid is None
    assert torch.equal(masked.valid, torch.arange(64).expand(48, 64) >= 17)  # one column mixes both
    assert masked.depth[:, :16].isnan().all() and (masked.ids[:, :16] == UNLABELLED).all()
    assert masked.depth[:, 17:].isfinite().all() and (masked.ids[:, 17:] >= 0).all()
    (tmp_path / "masks" / "0.png").unlink()
    with pytest.raises(CaptureError, match=r"1 of 1 masks are missing .* or pass --capture\.allow-missing\.$"):
        load_capture(tmp_path)


def test_keys_that_are_not_understood_are_named(tmp_path):
    heard = []

    def change(document):
        document |= {"ftheta_p0": 1.0, "aabb_scale": 4}
        document["frames"][0]["segmentation"] = "x.png"

    write_nerfstudio(tmp_path, views=2, change=change)
    load_capture(tmp_path, notify=heard.append)
    expected = "transforms.json: keys that are not understood: ftheta_p0, frames: segmentation"
    assert [event.message for event in heard] == [expected]


def first_frame(**changes):
    return lambda document: document["frames"][0].update(changes)


def pose_with(**cells):
    def change(document):
        for cell, value in cells.items():
            document["frames"][1]["transform_matrix"][int(cell[1])][int(cell[2])] = value

    return change


def scaled(document):
    for frame in document["frames"]:
        frame["transform_matrix"] = (np.diag([2.0, 2, 2, 1]) @ frame["transform_matrix"]).tolist()


def mirrored(document):
    document["frames"][0]["transform_matrix"] = (
        np.diag([-1.0, 1, 1, 1]) @ document["frames"][0]["transform_matrix"]
    ).tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(frames=[]), r"transforms\.json: lists no views"),
        (
            without("fl_x", "fl_y"),
            r"of 2 of 2 frames are not usable \(first: frames\[0\], images/0000\.png\): no focal length\. Give",
        ),
        (lambda d: d.update(fl_x=-5), "focal lengths are -5 and 51"),
        (lambda d: (without("fl_x", "fl_y")(d), d.update(camera_angle_x=4.0)), "focal lengths are 0 and 0"),
        (lambda d: d.update(cx=-500), "the principal point -500, 24.5 is outside the image of 64 x 48"),
        (lambda d: d.update(w=64.5), r"w and h are 64\.5 and 48"),
        (lambda d: d.update(w=0), "w and h are 0 and 48"),
        (
            lambda d: d.update(camera_model="ORTHOPHOTO"),
            "camera model ORTHOPHOTO is not supported. Undistort the images",
        ),
        (lambda d: d.update(k5=0.1), "k5 and k6 have no meaning in camera model OPENCV"),
        (lambda d: d.update(distortion_params=[0.1]), "k1 is 0, but 0.1 in distortion_params"),
        (lambda d: d.update(distortion_params=[0.0] * 7), "distortion_params has 7 numbers. Give at most six"),
        (lambda d: d.update(integer_depth_scale=-1, depth_unit_scale_factor=None), "integer_depth_scale is -1"),
        (lambda d: d.update(depth_unit_scale_factor=0), "depth_unit_scale_factor is 0"),
        (lambda d: d.update(k1=-5.0), r"distortion \(-5\.0.* leaves next to nothing of the image\. Check k1 to k4"),
        (lambda d: d.update(k1=1e300, k2=1e300), "leaves next to nothing of the image"),
        (
            lambda d: d.update(w=128, h=96, cx=60),
            r"2 of 2 images are not of the size .*0000\.png has 64 x 48, expected 128 x 96",
        ),
        (lambda d: d.update(ply_file_path="absent.ply"), r"absent\.ply: not found"),
        (
            first_frame(file_path="images/absent.png"),
            r"1 of 2 images are missing \(first: images/absent\.png\)\. .*allow-missing",
        ),
        (first_frame(file_path="images/0001.png"), r"1 of 2 views name an image twice \(first: images/0001\.png\)"),
        (first_frame(file_path="nul\0"), "1 of 2 images are missing"),
        (first_frame(file_path=""), "1 of 2 images are missing"),
        (first_frame(file_path="x" * 5000), "1 of 2 images are missing"),
        (
            first_frame(depth_file_path="no.png"),
            r"1 of 2 depth images are missing \(first: images/0000\.png\)\. .*no-use-depth",
        ),
        (first_frame(instance_file_path="no.png"), "1 of 2 id images are missing .*no-use-ids"),
        (first_frame(file_path=7), r"Expected `str`, got `int` - at `\$\.frames\[0\]\.file_path`"),
        (
            first_frame(transform_matrix=[[1, 0], [0, 1]]),
            r"1 of 2 poses are not usable \(first: frames\[0\], .*found 2 rows of \[2\]",
        ),
        (pose_with(c30=0.5), r"frames\[1\], images/0001\.png: its last row is 0\.5 0 0 1, not 0 0 0 1"),
        (pose_with(c00=5.0), "are not those of a rotation"),
        (pose_with(c00=1e200), "are not those of a rotation"),
        (pose_with(c03=1e30), "it is 1e.30 units away"),
        (scaled, r"2 of 2 poses are not usable .* of lengths 2 2 2, are not those of a rotation"),
        (mirrored, "it mirrors"),
    ],
)
def test_a_malformed_file_is_one_error(tmp_path, change, message):
    write_nerfstudio(tmp_path, views=2, change=change)
    with pytest.raises((CaptureError, FileError), match=message) as caught:
        load_capture(tmp_path)
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["x", "-1", "40000", "١"])
def test_a_label_of_no_id_is_refused(tmp_path, key):
    write_nerfstudio(tmp_path, views=1)
    (tmp_path / "labels.json").write_text(json.dumps({"1": "crate", key: "ghost"}))
    with pytest.raises(CaptureError, match=r"labels\.json: 1 of 2 names belong to no id \(first: "):
        load_capture(tmp_path)


def test_side_images_of_another_shape_are_refused(tmp_path):
    write_nerfstudio(tmp_path, views=1)
    write_png(tmp_path / "depth/0000.png", np.ones((48, 48), np.uint16))
    with pytest.raises(CaptureError, match=r"0000\.png: 48 x 48 pixels, another aspect ratio than the image's 64 x 48"):
        load_capture(tmp_path)
    (tmp_path / "depth/0000.npy").write_bytes(b"")
    np.save(tmp_path / "depth/0000.npy", np.ones((48, 48), np.float32))
    edit(tmp_path, first_frame(depth_file_path="depth/0000.npy"))
    with pytest.raises(CaptureError, match=r"0000\.npy: 48 x 48 pixels, another aspect ratio"):
        load_capture(tmp_path)[0]


def test_an_image_that_changed_after_loading_is_refused(tmp_path):
    capture = load_capture(write_nerfstudio(tmp_path, views=1), UNCHECKED)
    write_png(tmp_path / "images/0000.png", np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(CaptureError, match=r"0000\.png: 10 x 10 pixels, but its intrinsics are for 64 x 48"):
        capture[0]


def test_a_cut_image_is_an_error_when_it_is_decoded(tmp_path):
    write_nerfstudio(tmp_path, views=2)
    path = tmp_path / "images/0001.png"
    path.write_bytes(path.read_bytes()[:-500])
    capture = load_capture(tmp_path, UNCHECKED)
    assert capture[0].image.shape == (48, 64, 3)
    with pytest.raises(FileError, match=r"0001\.png: damaged or cut short"):
        capture[1]


def test_damaged_transforms_raise_only_our_errors(tmp_path):
    write_nerfstudio(tmp_path, views=2)
    good = (tmp_path / "transforms.json").read_bytes()
    refused = 0
    for mutant in mutants(good, 400, seed=0):
        (tmp_path / "transforms.json").write_bytes(mutant)
        try:
            load_capture(tmp_path, UNCHECKED)
        except (CaptureError, FileError) as error:
            refused += 1
            assert str(tmp_path) in str(error)
            assert "\n" not in str(error)
    assert refused > 100


@pytest.mark.parametrize("lens", [LENS, BENT])
def test_decoding_twice_gives_the_same(tmp_path, lens):
    write_nerfstudio(tmp_path, views=1, lens=lens)
    first, second = load_capture(tmp_path)[0], load_capture(tmp_path)[0]
    assert torch.equal(first.image, second.image)
    assert torch.equal(first.ids, second.ids)


def renamed(**names):
    """Give keys of all frames other names."""

    def change(document):
        for frame in document["frames"]:
            for old, new in names.items():
                frame[new] = frame.pop(old)

    return change


def test_instant_ngps_depth_is_read_under_its_names(tmp_path):
    def change(document):
        renamed(depth_file_path="depth_path")(document)
        document.pop("depth_unit_scale_factor")
        document["integer_depth_scale"] = 0.002
        for row in (row for frame in document["frames"] for row in frame["transform_matrix"]):
            row[:] = [value * 0.5 for value in row]  # homogeneous: [3][3] is 0.5

    write_nerfstudio(tmp_path, views=2, change=change)
    capture = load_capture(tmp_path, CaptureConfig(checks="off"))  # twice as deep as the room is
    np.testing.assert_allclose(capture[0].depth.numpy(), 2 * see(poses(2)[0]).depth, atol=2e-3)
    np.testing.assert_allclose(capture.cameras[1].world_from_cam.numpy(), poses(2)[1], atol=1e-6)
    edit(tmp_path, lambda document: document.update(enable_depth_loading=False))
    assert not load_capture(tmp_path).has_depth


@pytest.mark.parametrize(("scale", "stated"), [(1.0, None), (1000.0, None), (4.0, 0.25)])
def test_fractions_are_metres_unless_their_size_or_the_file_says_otherwise(tmp_path, scale, stated):
    def change(document):
        document["depth_unit_scale_factor"] = stated
        for number, frame in enumerate(document["frames"]):
            frame["depth_file_path"] = f"depth/{number}.npy"
            np.save(tmp_path / frame["depth_file_path"], (see(poses(2)[number]).depth * scale).astype(np.float32))

    write_nerfstudio(tmp_path, views=2, change=change)
    np.testing.assert_allclose(load_capture(tmp_path)[1].depth.numpy(), see(poses(2)[1]).depth, rtol=1e-5)


def test_distortion_may_be_listed_in_nerfstudios_order(tmp_path):
    write_nerfstudio(tmp_path / "named", views=2, lens=BENT)

    def change(document):
        document["distortion_params"] = [document.pop(name) for name in ("k1", "k2", "k3", "k4", "p1", "p2")]

    write_nerfstudio(tmp_path / "listed", views=2, lens=BENT, change=change)
    named, listed = load_capture(tmp_path / "named"), load_capture(tmp_path / "listed")
    assert torch.equal(named[0].image, listed[0].image) and torch.equal(named[0].depth, listed[0].depth)


@pytest.mark.parametrize(
    ("model", "kind"), [("OPENCV_FISHEYE", "fisheye"), ("FISHEYE", "fisheye"), ("FULL_OPENCV", "perspective")]
)
def test_camera_models_become_lenses(model, kind):
    shared = Intrinsics(
        camera_model=model, w=64, h=48, fl_x=50.0, k1=0.1, k2=0.2, k3=0.3, k4=0.4, fisheye_crop_radius=20.0
    )
    lens = lens_of_intrinsics(shared, Intrinsics(k2=0.5), None)
    assert lens.projection == kind
    if kind == "fisheye":
        assert lens.radial == (0.1, 0.5, 0.3, 0.4) and lens.circle_px == 20
    else:
        assert (lens.radial, lens.denominator) == ((0.1, 0.5, 0.3), (0.4, 0.0, 0.0))


def test_files_are_found_under_the_spellings_of_programs(tmp_path):
    """Windows' backslashes, no suffix, images_2 alone, and photographs that were uploaded flat."""
    spellings = ["images\\0000.png", "./images/0001", "images/0002.png", "elsewhere/0003.png"]

    def change(document):
        for frame, name in zip(document["frames"], spellings, strict=True):
            frame["file_path"] = name
        document["frames"][0]["depth_file_path"] = "depth\\0000.png"

    write_nerfstudio(tmp_path, views=4, change=change)
    half = np.asarray(Image.open(tmp_path / "images/0002.png").resize((32, 24)))
    write_png(tmp_path / "images_2/0002.png", half)
    (tmp_path / "images/0002.png").unlink()
    (tmp_path / "images/0003.png").rename(tmp_path / "0003.png")
    capture = load_capture(tmp_path)
    assert [camera.width for camera in capture.cameras] == [64, 64, 32, 64]
    np.testing.assert_allclose(capture.cameras[2].focal_px.numpy(), [25.0, 25.5])
    assert capture[0].depth.isfinite().all() and capture[0].ids is not None


def test_blenders_lists_are_read_one_at_a_time(tmp_path):
    write_nerfstudio(tmp_path, views=2)
    (tmp_path / "transforms.json").rename(tmp_path / "transforms_train.json")
    (tmp_path / "transforms_test.json").write_text((tmp_path / "transforms_train.json").read_text())
    heard = []
    assert len(load_capture(tmp_path, notify=heard.append)) == 2
    expected = "transforms_train.json is read; the views of transforms_test.json are not used"
    assert [event.message for event in heard] == [expected]


def test_points_on_a_national_grid_keep_their_digits(tmp_path):
    far = np.array([400_000.0, 5_800_000.0, 10.0])

    def change(document):
        for frame in document["frames"]:
            for axis in range(3):
                frame["transform_matrix"][axis][3] += far[axis]

    write_nerfstudio(tmp_path, views=2, change=change)
    places = captures.corners().positions.astype(np.float64) + 0.001
    columns = {axis: places[:, place] + far[place] for place, axis in enumerate("xyz")}
    write_ply(tmp_path / "points.ply", {"vertex": columns})
    capture = load_capture(tmp_path)
    np.testing.assert_allclose(capture.points.positions + (np.array(capture.offset) - far), places, atol=1e-5)
