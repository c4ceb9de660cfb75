"""Alignment of views on a textured room of boxes: it finds known errors, and leaves what is exact alone."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import captures
from cameras import pinhole
from goc import _native
from goc.align import AlignConfig, align
from goc.align.exposure import brightness_apart
from goc.align.images import coarse_view, samples_of
from goc.align.system import Given, Look, PairSums, compare, moved
from goc.capture.source import Lens
from goc.scene import Alignment, Capture, Frame, StoredFrames
from oracles import register

LENS = Lens(96, 72, (75.0, 75.0), (48.0, 36.0))
LOOK = Look(blur_px=1.0, reach=0.1, gap=0.005, typical=2.0)


def room(count=12, lens=LENS) -> Capture:
    """The textured room, exact."""
    frames = []
    for pose in captures.poses(count):
        shot = captures.see(pose, lens)
        camera = pinhole(lens.focal_px, (lens.width, lens.height), lens.centre_px, pose)
        depth, ids = torch.tensor(shot.depth, dtype=torch.float32), torch.tensor(shot.ids)
        frames.append(Frame(camera=camera, image=torch.tensor(shot.image), depth=depth, ids=ids))
    names = tuple(f"{number:04d}.png" for number in range(count))
    return Capture(
        cameras=tuple(frame.camera for frame in frames),
        view_names=names,
        frames=StoredFrames(tuple(frames)),
        has_depth=True,
        has_ids=True,
    )


def placed(capture: Capture, poses) -> Capture:
    """The same photographs from other cameras."""
    frames = [
        replace(frame, camera=replace(frame.camera, world_from_cam=torch.tensor(pose, dtype=torch.float32)))
        for frame, pose in zip(capture, poses, strict=True)
    ]
    return replace(capture, cameras=tuple(frame.camera for frame in frames), frames=StoredFrames(tuple(frames)))


def poses_of(cameras) -> np.ndarray:
    return np.stack([camera.world_from_cam.double().numpy() for camera in cameras])


def shaken(poses, metres=0.01, degrees=0.5, seed=0) -> np.ndarray:
    rng, out = np.random.default_rng(seed), poses.copy()
    for pose in out:
        pose[:3, :3] = (
            Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=3) / 3**0.5).as_matrix() @ pose[:3, :3]
        )
        pose[:3, 3] += metres * rng.normal(size=3) / 3**0.5
    return out


def errors(found, true) -> tuple[float, float]:
    """Root mean squares of position (m) and angle (deg) after both are brought together."""
    back = Rotation.from_matrix(true[:, :3, :3] @ found[:, :3, :3].transpose(0, 2, 1)).mean().as_matrix()
    apart = (found[:, :3, 3] - found[:, :3, 3].mean(0)) @ back.T - (true[:, :3, 3] - true[:, :3, 3].mean(0))
    turns = Rotation.from_matrix(back @ found[:, :3, :3] @ true[:, :3, :3].transpose(0, 2, 1)).magnitude()
    return float(np.sqrt((apart**2).sum(1).mean())), float(np.degrees(np.sqrt((turns**2).mean())))


def test_cameras_that_were_shaken_come_back():
    exact = room()
    true = poses_of(exact.cameras)
    found = align(placed(exact, shaken(true)), AlignConfig(exposure="off"))
    before, after = errors(shaken(true), true), errors(poses_of(found.cameras), true)
    assert before[0] > 0.008 and before[1] > 0.4
    assert after[0] < 0.25 * before[0] and after[1] < 0.25 * before[1]
    assert found.alignment is not None and found.alignment.moved
    assert found.alignment.metrics["depth_gap_after_m"] < 0.5 * found.alignment.metrics["depth_gap_before_m"]
    assert torch.equal(found[3].camera.world_from_cam, found.cameras[3].world_from_cam)


def test_an_exact_capture_stays_as_it_is():
    exact = room()
    found = align(exact, AlignConfig())
    assert found.frames is exact.frames and found.cameras is exact.cameras
    assert isinstance(found.alignment, Alignment) and not found.alignment.moved and found.alignment.exposure is None
    assert found.alignment.metrics["pose_disagreement_m"] < 0.002
    assert align(exact, AlignConfig(poses="off", exposure="off")) is exact


def test_the_mean_of_all_corrections_is_none():
    true = poses_of(room().cameras)
    given = shaken(true, seed=2)
    found = poses_of(align(placed(room(), given), AlignConfig(exposure="off")).cameras)
    assert (found - given)[:, :3, 3].mean(0) == pytest.approx(np.zeros(3), abs=1e-6)


def test_held_out_views_follow_and_have_no_say():
    given = shaken(poses_of(room().cameras))
    capture, train = placed(room(), given), [view for view in range(12) if view != 5]
    alone = given.copy()
    alone[5] = shaken(given, 0.01, 0.5, seed=7)[5]
    a, b = (
        poses_of(align(placed(room(), poses), AlignConfig(exposure="off"), train).cameras) for poses in (given, alone)
    )
    assert np.array_equal(a[train], b[train])
    assert errors(a, poses_of(room().cameras))[0] < 0.004
    assert len(capture) == 12


def test_brightness_is_compared_at_mid_grey_and_pairs_count_by_their_points():
    sums = np.zeros((3, _native.REGISTER_SUMS))
    sums[:, -2:] = [[1.0, 0.0], [0.5, 0.25], [1.0, 0.05]]  # the second trades gain for offset: mid-grey stays
    sums[:, 44 + 42] = [10.0, 40.0, 60.0]
    found = PairSums(pairs=[(0, 1), (1, 2), (2, 0)], sums=sums)
    assert brightness_apart(found) == pytest.approx(np.log(1.1))
    sums[2, 44 + 42] = 40.0
    assert brightness_apart(found) == 0.0


def test_gains_of_photographs_are_found():
    exact, rng = room(), np.random.default_rng(3)
    gains = np.exp(0.15 * rng.normal(size=(12, 3)))
    gains /= np.exp(np.log(gains).mean(0))
    frames = [
        replace(frame, image=(frame.image * torch.tensor(gain) * 0.6).round().to(torch.uint8))
        for frame, gain in zip(exact, gains, strict=True)
    ]
    found = align(replace(exact, frames=StoredFrames(tuple(frames))), AlignConfig(poses="off"))
    assert found.alignment is not None and found.alignment.exposure is not None
    assert found.alignment.exposure[..., 0].numpy() == pytest.approx(gains, rel=0.02)
    evened = torch.stack([frame.image.float().mean((0, 1)) for frame in found])
    plain = torch.stack([frame.image.float().mean((0, 1)) for frame in exact])
    assert (evened / plain).std(0).max() < 0.02


def test_any_number_of_threads_gives_the_same_bits():
    given = placed(room(), shaken(poses_of(room().cameras)))
    before, found = _native.thread_count(), []
    for threads in (1, 3):
        _native.set_thread_count(threads)
        found.append(poses_of(align(given, AlignConfig()).cameras))
    _native.set_thread_count(before)
    assert np.array_equal(*found)


def test_depth_of_unknown_scale_aligns_nothing():
    capture = replace(room(3), depth_kind="affine")
    assert align(capture, AlignConfig()) is capture


@pytest.fixture(scope="module")
def pair():
    """Two views that see one surface, the second one's camera a little wrong."""
    capture = room(30, Lens(64, 48, (50.0, 50.0), (32.0, 24.0)))
    views = [coarse_view(capture, index) for index in (0, 1)]
    poses = shaken(poses_of(capture.cameras[:2]), 0.004, 0.2)
    return views, [samples_of(view, 32) for view in views], poses


def test_the_kernel_sums_what_its_twin_sums(pair):
    views, samples, poses = pair
    found = compare(views, samples, [[1], []], poses, LOOK).sums[0]
    shades = [view.shade(LOOK.blur_px) for view in views]
    gaps, greys = register.matches(
        samples[0], shades[0][samples[0].pixels], poses[0], views[1], poses[1], shades[1], LOOK.limits
    )
    assert len(gaps) > 100
    expected = register.sums(gaps)
    assert found[:44] == pytest.approx(expected, rel=1e-3, abs=1e-4 * np.abs(expected).max())
    assert found[44 + 42] == len(greys)
    gain, offset = found[88:90]
    left = np.array([seen - gain * own - offset for own, seen, _ in greys])
    assert found[44 + 43] == pytest.approx(np.abs(left).sum(), rel=1e-3)
    assert gain == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("axis", range(6))
def test_levers_are_the_derivatives_of_gaps_and_greys(pair, axis):
    """A small twist of the points, in the target's axes, against finite differences of every residual."""
    views, samples, poses = pair
    shades, step = [view.shade(LOOK.blur_px) for view in views], 1e-5
    twist = np.zeros(6)
    twist[axis] = step
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = Rotation.from_rotvec(twist[:3]).as_matrix(), twist[3:]
    pushed = poses[1] @ move @ np.linalg.inv(poses[1]) @ poses[0]
    args = (samples[0], shades[0][samples[0].pixels])
    still = register.matches(*args, poses[0], views[1], poses[1], shades[1], LOOK.limits)
    after = register.matches(*args, pushed, views[1], poses[1], shades[1], LOOK.limits)
    if len(still[0]) == len(after[0]):
        change = np.array([b[0] - a[0] for a, b in zip(still[0], after[0], strict=True)])
        levers = np.array([a[1][axis] for a in still[0]])
        assert np.median(np.abs(change - step * levers)) < 1e-3 * step
    if len(still[1]) == len(after[1]):
        change = np.array([b[1] - a[1] for a, b in zip(still[1], after[1], strict=True)])
        levers = np.array([a[2][axis] for a in still[1]])
        assert np.median(np.abs(change - step * levers)) < 1e-3 * step
    assert len(still[0]) == len(after[0]) or len(still[1]) == len(after[1])


def test_a_fixed_camera_does_not_move(pair):
    views, samples, poses = pair
    found = compare(views, samples, [[1], []], poses, LOOK)
    given = Given(poses=poses, position=1.0, angle=1.0, fixed=np.array([1.0, 0.0]))
    out = moved(poses, found, given)
    assert np.array_equal(out[0], poses[0]) and not np.array_equal(out[1], poses[1])
