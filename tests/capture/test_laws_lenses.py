"""Lenses, poses and scale: what distortion, rigid repair and the guessed unit must keep, over lenses and paths."""

from dataclasses import replace

import numpy as np
import pytest

from cameras import random_poses, ring
from goc.capture.distortion import distort, kept_box, sampling_grid
from goc.capture.poses import OPENCV_FROM_OPENGL, PoseError, rigid
from goc.capture.scale import guess_units_per_metre
from goc.capture.source import Lens, count_of, parse_id_names, shown
from goc.errors import CaptureError
from laws import MOTIONS, SCALES, only, over

PLAIN = Lens(64, 48, (50.0, 51.0), (31.0, 24.5))
LENSES = {
    "pinhole": PLAIN,
    "barrel": replace(PLAIN, radial=(-0.12, 0.01, 0.0, 0.0)),
    "pincushion": replace(PLAIN, radial=(0.15, 0.02, 0.0, 0.0)),
    "high orders": replace(PLAIN, radial=(0.02, -0.03, 0.02, -0.01)),
    "askew": replace(PLAIN, tangential=(0.01, -0.02)),
    "everything": replace(PLAIN, radial=(-0.05, 0.02, -0.01, 0.002), tangential=(0.003, 0.004)),
    "one row": replace(PLAIN, height=1, centre_px=(31.0, 0.5)),
}
DIRECTIONS = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 11), np.linspace(-0.4, 0.4, 9)), -1)


@over(lens=LENSES)
def test_the_axis_stays_and_small_angles_are_those_of_a_pinhole(lens):
    assert not distort(lens, np.zeros(2)).any()
    for size in (1e-3, 1e-5):
        small = size * DIRECTIONS
        np.testing.assert_allclose(distort(lens, small), small, atol=0.2 * size**2)


@over(lens=only(LENSES, "pinhole", "barrel", "pincushion", "high orders"))
@pytest.mark.parametrize("angle", [0.3, np.pi / 2, np.pi])
def test_radial_distortion_turns_with_its_directions(lens, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    np.testing.assert_allclose(distort(lens, DIRECTIONS @ turn.T), distort(lens, DIRECTIONS) @ turn.T, atol=1e-12)


@over(lens=LENSES)
def test_mirroring_the_image_mirrors_the_tangential_terms(lens):
    mirror = np.array([-1.0, 1.0])
    mirrored = replace(lens, tangential=(lens.tangential[0], -lens.tangential[1]))
    np.testing.assert_allclose(distort(mirrored, DIRECTIONS * mirror), distort(lens, DIRECTIONS) * mirror, atol=1e-15)


@over(lens=LENSES)
def test_every_kept_pixel_comes_from_where_the_lens_bends_it_to(lens):
    left, top, right, bottom = kept_box(lens)
    assert 0 <= left < right <= lens.width and 0 <= top < bottom <= lens.height
    grid = sampling_grid(lens).numpy()
    assert grid.shape == (bottom - top, right - left, 2) and np.abs(grid).max() <= 1 + 1e-6
    u, v = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
    directions = (np.stack([u, v], -1) - lens.centre_px) / lens.focal_px
    source = (grid + 1) / 2 * [lens.width, lens.height]
    np.testing.assert_allclose(source, distort(lens, directions) * lens.focal_px + lens.centre_px, atol=2e-5)


@over(lens=only(LENSES, "barrel", "pincushion", "askew", "everything"), scale={"half": 0.5, "double": 2.0, "ten": 10.0})
def test_a_finer_raster_keeps_the_same_field(lens, scale):
    fine = replace(
        lens,
        width=int(scale * lens.width),
        height=int(scale * lens.height),
        focal_px=tuple(scale * f for f in lens.focal_px),
        centre_px=tuple(scale * c for c in lens.centre_px),
    )
    box, finer = np.array(kept_box(lens)), np.array(kept_box(fine))
    assert np.abs(finer / scale - box).max() <= 1 + 1 / scale


def test_coefficients_that_leave_nothing_are_refused():
    with pytest.raises(CaptureError, match="leaves next to nothing of the image"):
        kept_box(replace(PLAIN, radial=(-30.0, 0.0, 0.0, 0.0)))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-3])
def test_rigid_finds_the_nearest_rotation_and_is_idempotent(seed, noise):
    pose = random_poses(1, seed, 50.0)[0]
    spoilt = pose.copy()
    spoilt[:3, :3] += noise * np.random.default_rng(seed).uniform(-1, 1, (3, 3))
    exact = rigid(spoilt)
    np.testing.assert_allclose(exact[:3, :3].T @ exact[:3, :3], np.eye(3), atol=1e-14)
    assert np.abs(exact - pose).max() <= 3 * noise + 1e-12
    np.testing.assert_allclose(rigid(exact), exact, atol=1e-14)
    np.testing.assert_array_equal(rigid(spoilt[:3])[:3], exact[:3])
    left = random_poses(1, seed + 100, 0.0)[0]  # a rotation of the world turns the answer along
    np.testing.assert_allclose(rigid(left @ spoilt), left @ exact, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda pose: pose[:2], "expected 4 x 4 numbers, found 2 rows"),
        (lambda pose: pose[:, :3], r"found 4 rows of \[3\]"),
        (lambda pose: pose * [[1], [np.nan], [1], [1]], "not finite"),
        (lambda pose: pose + [[0], [0], [0], [0.1]], "its last row is"),
        (lambda pose: pose * [[1.1], [1.1], [1.1], [1]], "not those of a rotation"),
        (lambda pose: pose @ np.diag([1, 1, -1, 1]), "it mirrors"),
        (lambda pose: pose + np.eye(4, 4, 3) * 1e9, "units away"),
        (lambda pose: pose + np.eye(4, 4, 1) * 0.2, "not those of a rotation"),
    ],
)
def test_what_is_no_pose_is_told_why(change, message):
    with pytest.raises(PoseError, match=message):
        rigid(change(random_poses(1, 3)[0]))


def test_opengl_axes_are_a_half_turn_about_x():
    np.testing.assert_array_equal(OPENCV_FROM_OPENGL @ OPENCV_FROM_OPENGL, np.eye(4))
    assert np.linalg.det(OPENCV_FROM_OPENGL) == 1.0


@over(motion=MOTIONS, scale=SCALES)
def test_the_guessed_unit_scales_with_the_world_and_ignores_where_it_is(motion, scale):
    poses = ring(np.linspace(0.0, 4.0, 9), 1.7, 0.4)
    moved = [motion @ pose for pose in poses]
    for pose in moved:
        pose[:3, 3] *= scale
    assert guess_units_per_metre(moved) == pytest.approx(scale * guess_units_per_metre(poses), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_guessed_unit_ignores_the_order_of_views(seed):
    poses = ring(np.linspace(0.0, 5.0, 11), 2.0, 0.8)
    order = np.random.default_rng(seed).permutation(len(poses))
    assert guess_units_per_metre([poses[i] for i in order]) == pytest.approx(guess_units_per_metre(poses))


@pytest.mark.parametrize(
    ("name", "words"),
    [("a.jpg", "a.jpg"), ("", "''"), ("a\nb", r"'a\nb'"), ("x" * 200, "x" * 120 + "…"), ("café.png", "café.png")],
)
def test_names_from_files_fit_one_line(name, words):
    assert shown(name) == words


def test_names_of_ids_need_ids(tmp_path):
    assert parse_id_names(tmp_path, {"0": "room", "32767": "last"}) == {0: "room", 32767: "last"}
    for bad in ("-1", "1.0", "32768", "", "٣", "seven"):
        with pytest.raises(CaptureError, match=r"1 of 2 names belong to no id \(first: .*Use ids 0 to 32767"):
            parse_id_names(tmp_path, {"1": "chair", bad: "what"})
    assert count_of([1, 2, 3], 120) == "3 of 120"
