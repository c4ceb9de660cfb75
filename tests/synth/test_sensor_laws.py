import numpy as np
import pytest

from cameras import pinhole
from goc.errors import ConfigError
from goc.files.colour import decode_srgb, encode_srgb
from goc.scene import ROOM, UNLABELLED
from goc.synth.sensor import (
    ImageFaults,
    Lidar,
    MonocularDepth,
    PoseFaults,
    SensorConfig,
    StructuredLight,
    corrupt_masks,
    expose,
    lidar_depth,
    monocular_depth,
    monocular_normals,
    motion_blur,
    perturb_pose,
    structured_light_depth,
)

HEIGHT, WIDTH = 96, 128
CAMERA = pinhole(100.0, (WIDTH, HEIGHT))
QUIET = {"noise_m": 0.0, "noise_per_m": 0.0}
STILL = {"jitter_px": 0.0, "disparity_step": 0.0, "grazing_deg": 90.0, "edge_holes": 0.0}


def rng(seed=0):
    return np.random.default_rng(seed)


def flat(z):
    return np.full((HEIGHT, WIDTH), z)


def tilted(angle_deg, z=2.0):
    """z of a plane whose normal is turned by an angle about the vertical, z on the optical axis."""
    x = (np.arange(WIDTH) + 0.5 - 64) / 100
    return np.broadcast_to(z / (1 - np.tan(np.radians(angle_deg)) * x), (HEIGHT, WIDTH)).copy()


def step_edge(near=1.5, far=3.0):
    depth = flat(far)
    depth[:, : WIDTH // 2] = near
    return depth


@pytest.mark.parametrize("z", [0.8, 2.0, 4.0])
def test_structured_light_noise_grows_as_stated(z):
    config = StructuredLight(noise_m=0.002, noise_per_m=0.003, **STILL)
    error = structured_light_depth(flat(z), CAMERA, config, rng()) - z
    assert np.std(error) == pytest.approx(0.002 + 0.003 * z * z, rel=0.03)  # 12,288 samples: 0.6 % is one sigma
    assert abs(np.mean(error)) < 4 * np.std(error) / error.size**0.5


def test_disparity_is_quantised_so_that_depths_lie_z_squared_times_the_step_apart():
    config = StructuredLight(**QUIET, **(STILL | {"disparity_step": 0.004}))
    ramp = np.linspace(2.0, 3.0, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    levels = np.unique(structured_light_depth(ramp, CAMERA, config, rng()))
    np.testing.assert_allclose(np.diff(1 / levels), -0.004, rtol=1e-6)
    np.testing.assert_allclose(np.diff(levels), 0.004 * levels[:-1] * levels[1:], rtol=1e-6)


def test_grazing_surfaces_are_holes_and_only_they():
    config = StructuredLight(**QUIET, **(STILL | {"grazing_deg": 60.0}))
    depth = tilted(45.0)
    measured = structured_light_depth(depth, CAMERA, config, rng())
    x, y = np.meshgrid((np.arange(WIDTH) + 0.5 - 64) / 100, (np.arange(HEIGHT) + 0.5 - 48) / 100)
    normal = np.array([np.sin(np.radians(45)), 0, -np.cos(np.radians(45))])
    ray = np.stack([x, y, np.ones_like(x)], -1)
    angle = np.degrees(np.arccos(np.abs(ray @ normal) / np.linalg.norm(ray, axis=-1)))
    inner = (slice(2, -2), slice(2, -2))
    clear = np.abs(angle - 60) > 0.2
    assert (np.isnan(measured) == (angle > 60))[inner][clear[inner]].all() and (angle > 60).any()


def test_half_of_the_pixels_beside_a_jump_are_holes():
    config = StructuredLight(**QUIET, **(STILL | {"edge_holes": 0.5}))
    lost = np.mean(
        [np.isnan(structured_light_depth(step_edge(), CAMERA, config, rng(i))).mean(0) for i in range(20)], 0
    )
    beside = np.zeros(WIDTH, bool)
    beside[[WIDTH // 2 - 1, WIDTH // 2]] = True
    assert (lost[~beside] == 0).all()
    assert lost[beside].mean() == pytest.approx(0.5, abs=0.04)  # 3,840 pixels


def test_jitter_frays_an_edge_by_its_width_and_invents_no_depth():
    config = StructuredLight(**QUIET, **(STILL | {"jitter_px": 2.0}))
    measured = np.stack([structured_light_depth(step_edge(), CAMERA, config, rng(i)) for i in range(10)])
    assert set(np.unique(measured)) == {1.5, 3.0}
    wrong = (measured != step_edge()).mean((0, 1))
    # A pixel d beyond the edge reads the other side where the normal shift exceeds d + 1/2: mean over both sides.
    assert wrong.sum() == pytest.approx(2 * 2.0 / np.sqrt(2 * np.pi), rel=0.1)


def test_out_of_range_is_nothing():
    config = StructuredLight(**QUIET, **STILL, min_m=0.5, max_m=4.0)
    for z, measured in [(0.49, False), (0.5, True), (4.0, True), (4.01, False)]:
        assert np.isfinite(structured_light_depth(flat(z), CAMERA, config, rng())).all() == measured


def test_a_fault_keeps_its_randomness_when_another_is_switched():
    both = structured_light_depth(flat(2.0), CAMERA, StructuredLight(**(STILL | {"jitter_px": 1.0})), rng())
    alone = structured_light_depth(flat(2.0), CAMERA, StructuredLight(**STILL), rng())
    np.testing.assert_array_equal(both, alone)


def test_a_phone_sees_planes_as_they_are():
    depth = tilted(30.0)
    np.testing.assert_allclose(lidar_depth(depth, Lidar(**QUIET), rng()), depth, rtol=1e-9)


def test_a_phone_turns_an_edge_into_a_ramp_one_cell_wide():
    measured = lidar_depth(step_edge(), Lidar(columns=32, **QUIET), rng())
    between = (measured > 1.5 + 1e-9) & (measured < 3.0 - 1e-9)
    assert (between.sum(1) == WIDTH / 32).all()


def test_phone_noise_at_the_middles_of_cells_is_as_stated():
    config = Lidar(columns=WIDTH, noise_m=0.01, noise_per_m=0.002)  # a cell a pixel
    assert np.std(lidar_depth(flat(3.0), config, rng())) == pytest.approx(0.01 + 0.002 * 9, rel=0.03)
    assert np.isnan(lidar_depth(flat(5.1), config, rng())).all()


@pytest.mark.parametrize("kind", ["affine", "inverse"])
def test_monocular_depth_is_exact_up_to_its_own_scale_and_offset(kind):
    config = MonocularDepth(kind=kind, waves=0.0, blur_px=0.0, noise=0.0)
    depth = tilted(40.0)
    stored = monocular_depth(depth, config, rng(3))
    value = stored.values / 65535
    wanted = depth if kind == "affine" else 1 / depth
    scale, offset = np.polyfit(value.ravel(), wanted.ravel(), 1)
    assert (scale, offset) == pytest.approx((stored.scale, stored.offset), rel=1e-4)
    assert np.abs(stored.scale * value + stored.offset - wanted).max() <= 0.51 * stored.scale / 65535
    assert np.ptp(value) >= 1 / 1.6 - 1e-3


def test_monocular_values_tell_no_depth():
    near = monocular_depth(tilted(40.0, 1.0), MonocularDepth(), rng(5))
    far = monocular_depth(tilted(40.0, 3.0), MonocularDepth(), rng(5))
    assert np.abs(near.values.astype(int) - far.values).max() <= 1  # the same picture at three times the size
    assert far.scale == pytest.approx(3 * near.scale)
    assert (
        monocular_depth(tilted(40.0), MonocularDepth(), rng(6)).offset
        != monocular_depth(tilted(40.0), MonocularDepth(), rng(7)).offset
    )


def test_monocular_waves_and_noise_are_as_strong_as_stated():
    def relative(**strength):
        off = {"waves": 0.0, "blur_px": 0.0, "noise": 0.0}
        stored = monocular_depth(flat(2.0), MonocularDepth(**(off | strength)), rng(1))
        return (stored.scale * stored.values / 65535 + stored.offset) / 2 - 1

    waves = relative(waves=0.05)
    assert np.sqrt(np.mean(waves**2)) == pytest.approx(0.05, rel=1e-3)
    assert np.abs(np.diff(waves, axis=1)).max() < 0.015  # it changes slowly
    assert np.std(relative(noise=0.02)) == pytest.approx(0.02, rel=0.03)


def test_monocular_holes_stay_holes_and_lend_nothing():
    depth = flat(2.0)
    depth[20:40, 30:50] = np.nan
    stored = monocular_depth(depth, MonocularDepth(waves=0.0, noise=0.0), rng())
    assert (stored.values == 0).sum() == 400 and np.ptp(stored.values[stored.values > 0]) <= 1
    assert (monocular_depth(np.full((8, 8), np.nan), MonocularDepth(), rng()).values == 0).all()


def test_monocular_normals_are_off_by_the_stated_angle():
    exact = np.array([np.sin(np.radians(30)), 0, -np.cos(np.radians(30))])
    angles = []
    for seed in range(8):
        normals = monocular_normals(tilted(30.0), CAMERA, MonocularDepth(normal_error_deg=6.0), rng(seed))
        angles.append(np.degrees(np.arccos(np.clip(normals @ exact, -1, 1))))
    # Of a rotation by an angle about a random axis, a given direction feels √(2/3).
    assert np.sqrt(np.mean(np.square(angles))) == pytest.approx(6 * np.sqrt(2 / 3), rel=0.15)
    clean = monocular_normals(tilted(30.0), CAMERA, MonocularDepth(normal_error_deg=0.0), rng())
    np.testing.assert_allclose(clean, np.broadcast_to(exact, clean.shape), atol=1e-3)


def test_motion_blur_makes_a_ramp_of_its_length_in_linear_light():
    light = np.zeros((9, 40, 3))
    light[:, 20:] = 1.0
    blurred = motion_blur(light, np.array([8.0, 0.0]))
    np.testing.assert_allclose(blurred[4, :, 0], np.clip((np.arange(40) - 19.5) / 8 + 0.5, 0, 1), atol=0.02)
    np.testing.assert_allclose(motion_blur(light, np.array([0.0, 8.0])), light, atol=1e-12)
    np.testing.assert_allclose(motion_blur(np.full((5, 5, 3), 0.3), np.array([2.5, -1.7])), 0.3)


def test_one_stop_doubles_the_light():
    grey = np.full((2, 2, 3), 0.2)
    np.testing.assert_allclose(expose(grey, 1.0), 0.4)
    np.testing.assert_allclose(expose(grey, 9.0), 1.0)
    every = np.arange(255, dtype=np.uint8).reshape(1, 85, 3)
    np.testing.assert_array_equal(encode_srgb(decode_srgb(every)), every)


def test_poses_are_turned_and_shifted_by_the_stated_amounts():
    config, pose = PoseFaults(rotation_deg=2.0, translation_m=0.03), np.eye(4)
    noisy = np.stack([perturb_pose(pose, config, rng(i)) for i in range(2000)])
    angles = np.degrees(np.arccos(np.clip((np.trace(noisy[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert np.sqrt(np.mean(angles**2)) == pytest.approx(2.0, rel=0.05)
    assert np.sqrt(np.mean(np.sum(noisy[:, :3, 3] ** 2, -1))) == pytest.approx(0.03, rel=0.05)
    gram = noisy[:, :3, :3] @ noisy[:, :3, :3].transpose(0, 2, 1)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), atol=1e-12)


def masks():
    """Nine discs, two of which touch, in a room."""
    ids = np.zeros((90, 90), np.int16)
    row, column = np.indices(ids.shape)
    for key in range(9):
        ids[np.hypot(row - 15 - 30 * (key // 3), column - 15 - 30 * (key % 3)) < (15.2 if key < 2 else 11)] = key + 1
    return ids


def test_the_share_of_corrupted_masks_is_as_stated():
    ids, share = masks(), 0.3
    touched = []
    for seed in range(300):
        changed = corrupt_masks(ids, share, rng(seed)) != ids
        touched.append(sum(changed[ids == key].any() or changed[_rim(ids == key)].any() for key in range(1, 10)) / 9)
    # 0.3, and the partners of exchanges (a sixth of the masks); masks that grow into a neighbour touch it too.
    assert 0.3 <= np.mean(touched) < 0.3 * 1.5
    np.testing.assert_array_equal(corrupt_masks(ids, 0.0, rng()), ids)


def _rim(mask):
    grown = np.zeros_like(mask)
    grown[1:-1, 1:-1] = mask[2:, 1:-1] | mask[:-2, 1:-1] | mask[1:-1, 2:] | mask[1:-1, :-2]
    return grown & ~mask


def test_each_corruption_does_what_it_says():
    ids = np.zeros((40, 40), np.int16)
    ids[10:30, 5:15] = 3
    ids[10:30, 15:25] = 7  # shares a border of 20 pixels with 3
    seen = set()
    for seed in range(80):
        result = corrupt_masks(ids, 0.5, rng(seed))
        seen.add(_effect(ids, result))
    assert seen == {"exchange", "replace", "room", "unlabelled", "grown", "shrunk"}


def _effect(ids, result):
    for key, other in ((3, 7), (7, 3)):
        where = result[ids == key]
        if (where == other).all():
            return "exchange" if (result[ids == other] == key).all() else "replace"
        if (where == ROOM).all():
            return "room"
        if (where == UNLABELLED).all():
            return "unlabelled"
    return "grown" if (result == ROOM).sum() < (ids == ROOM).sum() else "shrunk"


def test_masks_grow_and_shrink_by_2_to_6_pixels():
    ids = np.zeros((60, 60), np.int16)
    ids[20:40, 20:40] = 1
    widths = {np.abs(np.sqrt((corrupt_masks(ids, 1.0, rng(seed)) == 1).sum()) - 20) for seed in range(60)} - {0.0, 20.0}
    assert 2 <= min(widths) and max(widths) <= 12.0


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: StructuredLight(noise_m=-1.0), "StructuredLight.noise_m is -1: needs 0 to 1"),
        (
            lambda: StructuredLight(max_m=0.1),
            "StructuredLight.min_m is 0.4: needs less than StructuredLight.max_m .0.1.",
        ),
        (lambda: Lidar(columns=1), "Lidar.columns is 1"),
        (lambda: MonocularDepth(waves=float("nan")), "MonocularDepth.waves is nan"),
        (lambda: ImageFaults(exposure_ev=9.0), "ImageFaults.exposure_ev is 9"),
        (lambda: PoseFaults(rotation_deg=91.0), "PoseFaults.rotation_deg is 91"),
        (lambda: SensorConfig(masks=1.1), "SensorConfig.masks is 1.1: needs 0 to 1"),
    ],
)
def test_settings_out_of_range_are_refused(make, text):
    with pytest.raises(ConfigError, match=text):
        make()
