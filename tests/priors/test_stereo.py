"""Stereo against its slow twin, on planes whose depth is known, and on a benchmark room."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cameras import capture_of, pinhole, placed
from goc import _native
from goc.capture import CaptureConfig, load_capture
from goc.errors import ConfigError
from goc.geometry.native_camera import native_camera
from goc.priors import PriorsConfig, StereoConfig, add_priors
from goc.priors.stereo import stereo_depths
from goc.reconstruct import ReconstructConfig
from goc.reconstruct.seed import seed
from goc.scene import Camera, Capture, Frame
from oracles import stereo as slow

SMALL = StereoConfig(side_px=96, neighbours=5, planes=64)
NORMAL = np.array([0.25, -0.1, -1.0]) / np.linalg.norm([0.25, -0.1, -1.0])
ORIGIN = np.array([0.0, 0.0, 2.0])


def camera(shift: list[float], turn: float = 0.0, width: int = 96, height: int = 72) -> Camera:
    scale = width / 96
    return pinhole(
        (80.0 * scale, 82.0 * scale), (width, height), (width / 2 - 1.3, height / 2 + 0.7), placed(shift, turn)
    )


AROUND = [camera([x, y, 0.03 * x], -0.3 * x) for x in (-0.35, 0.0, 0.35) for y in (-0.25, 0.25)]


def plane_depth(view: Camera) -> torch.Tensor:
    rays = view.rays().double() @ view.world_from_cam[:3, :3].double().T
    distance = (torch.from_numpy(ORIGIN) - view.position.double()) @ torch.from_numpy(NORMAL)
    return (distance / (rays @ torch.from_numpy(NORMAL))).float()


def texture(points: np.ndarray) -> np.ndarray:
    random = np.random.default_rng(5)
    directions = random.normal(size=(40, 3))
    waves = 2 * np.pi / random.uniform(0.12, 0.6, 40)
    directions *= (waves / np.linalg.norm(directions, axis=1))[:, None]
    return np.clip(127 + 25 * np.sin(points @ directions.T + random.uniform(0, 6, 40)).sum(-1), 0, 255)


def photograph(view: Camera, blank: bool = False) -> Frame:
    depth = plane_depth(view)
    local = (view.rays() * depth[..., None]).double()
    pose = view.world_from_cam.double()
    grey = texture((local @ pose[:3, :3].T + pose[:3, 3]).numpy())
    image = torch.from_numpy(np.rint(grey).astype(np.uint8))[..., None].expand(*depth.shape, 3).contiguous()
    return Frame(camera=view, image=torch.full_like(image, 128) if blank else image)


def photographed(views: list[Camera], blank: bool = False, **facts) -> Capture:
    return capture_of([photograph(view, blank) for view in views], **facts)


def photos(views: list[Camera]) -> tuple[_native.Photos, list[np.ndarray]]:
    greys = [photograph(view).image.float().mean(-1).numpy() for view in views]
    return _native.Photos(np.stack(greys), [native_camera(view) for view in views]), greys


def others_of(count: int) -> np.ndarray:
    return np.array([[other for other in range(count) if other != view] for view in range(count)], np.int32)


def test_the_sweep_without_smoothing_takes_the_plane_its_slow_twin_finds_cheapest():
    views = [
        camera(shift, width=24, height=18)
        for shift in ([0, 0, 0], [0.3, 0, 0], [0, 0.3, 0.1], [-0.3, 0.1, 0], [0.2, 0.2, 0])
    ]
    taken, greys = photos(views)
    inverse, costs = (np.zeros((5, 18, 24), np.float32) for _ in "12")
    ranges = np.tile(np.array([[0.2, 1.0]], np.float32), (5, 1))
    _native.stereo_sweep(taken, 0, 1, others_of(5), ranges, 16, 0.0, 0.0, inverse, costs)
    steps = 0.2 + np.arange(16) * 0.8 / 15
    volume = np.stack([slow.sweep_costs(greys, views, [1, 2, 3, 4], step) for step in steps])
    np.testing.assert_allclose(costs[0], volume.min(0), atol=2e-3)  # sums of squares of bytes in float32
    nearest = np.rint((inverse[0] - 0.2) * 15 / 0.8).astype(int)
    assert (np.abs(nearest - volume.argmin(0)) <= 1).mean() > 0.98  # between planes by a parabola; ties


def test_refined_planes_cost_what_the_slow_twin_says():
    views = [camera(shift, width=24, height=18) for shift in ([0, 0, 0], [0.3, 0, 0], [0, 0.3, 0.1], [-0.3, 0.1, 0])]
    taken, greys = photos(views)
    planes, costs = np.zeros((4, 18, 24, 3), np.float32), np.zeros((4, 18, 24), np.float32)
    planes[..., 0] = 0.5
    _native.stereo_refine(taken, 0, 1, others_of(4), np.full(4, 0.05, np.float32), 2, 0.0, 3, planes, costs)
    assert np.abs(planes[0, ..., 0] - 0.5).max() > 0.01
    for x, y in [(0, 0), (5, 3), (12, 9), (23, 17), (20, 2), (7, 16)]:
        twin = slow.patch_cost(greys, views, [1, 2, 3], (x, y), planes[0, y, x].astype(np.float64))
        assert costs[0, y, x] == pytest.approx(twin, abs=2e-3)


@pytest.mark.parametrize("metre", [1.0, 40.0])
def test_a_textured_plane_is_measured(metre):
    views = [replace(view, world_from_cam=view.world_from_cam.clone()) for view in AROUND]
    capture = photographed(views)
    if metre != 1.0:
        for view in views:
            view.world_from_cam[:3, 3] *= metre
        capture = replace(capture, units_per_metre=metre)
    found = stereo_depths(capture, list(range(6)), SMALL)
    errors, trusted = [], []
    for view, truth in zip(found.values(), AROUND, strict=True):
        error = (view.depth / metre - plane_depth(truth)).abs() / plane_depth(truth)
        trusted.append(torch.isfinite(error).float().mean())
        errors.append(error[torch.isfinite(error)])
    assert torch.cat(errors).median() < 0.005
    assert (torch.cat(errors) < 0.02).float().mean() > 0.97
    assert np.mean(trusted) > 0.7


def test_one_thread_gives_the_same_bits_as_three():
    capture, threads = photographed(AROUND), _native.thread_count()
    found = []
    for count in (1, 3):
        _native.set_thread_count(count)
        found.append(stereo_depths(capture, [0, 1, 2, 3, 5], replace(SMALL, side_px=64)))
    _native.set_thread_count(threads)
    for one, three in zip(found[0].values(), found[1].values(), strict=True):
        assert torch.equal(one.depth.nan_to_num(-1), three.depth.nan_to_num(-1))


def test_photographs_without_texture_are_not_trusted():
    found = stereo_depths(photographed(AROUND, blank=True), list(range(6)), SMALL)
    assert all(torch.isnan(view.depth).all() for view in found.values())


def test_many_views_are_thinned():
    found = stereo_depths(photographed(AROUND), list(range(6)), replace(SMALL, side_px=48, max_views=3))
    assert list(found) == [0, 2, 4]


def agreement(factors: list[float]) -> tuple[np.ndarray, ...]:
    """True planes of views 0, 1, 4 with their inverse depths off by the given factors."""
    views = [AROUND[0], AROUND[2], AROUND[4]]
    planes = np.zeros((3, 72, 96, 3), np.float32)
    for place, view in enumerate(views):
        inverse = 1.0 / plane_depth(view).numpy()
        planes[place, ..., 0] = inverse * factors[place]
        planes[place, ..., 1] = np.gradient(inverse, axis=1) * factors[place]
        planes[place, ..., 2] = np.gradient(inverse, axis=0) * factors[place]
    inverse = np.zeros((3, 72, 96), np.float32)
    agreeing, against = (np.zeros((3, 72, 96), np.uint8) for _ in "12")
    _native.stereo_agree(photos(views)[0], 0, 3, others_of(3), planes, 1.0, 0.02, inverse, agreeing, against)
    return inverse * [[[1.0]]], agreeing, against, planes[..., 0]


def test_true_planes_agree_wherever_two_views_look():
    inverse, agreeing, against, truth = agreement([1.0, 1.0, 1.0])
    assert against.max() == 0
    middle = np.s_[:, 30:42, 40:56]
    assert (agreeing[middle] >= 1).mean() > 0.95
    np.testing.assert_allclose(inverse, truth, rtol=1e-3)


def test_a_wrong_depth_is_refused():
    _, agreeing, against, _ = agreement([1.2, 1.0, 1.0])
    assert agreeing[0].max() == 0
    assert against[0, 30:42, 40:56].min() >= 1  # it stands in front of what the others see
    _, agreeing, against, _ = agreement([0.8, 1.0, 1.0])
    assert agreeing[0].max() == 0
    assert against[0].max() == 0  # behind: that may be occlusion


def test_seeds_of_photographs_lie_on_the_surface():
    config = ReconstructConfig(mcmc=replace(ReconstructConfig().mcmc, max_splats=1500))
    splats = seed(add_priors(photographed(AROUND), PriorsConfig(stereo=SMALL)), list(range(6)), config)
    off = ((splats.means.double().numpy() - ORIGIN) @ NORMAL) / 2.0
    assert len(splats) > 1000
    assert np.median(np.abs(off)) < 0.005
    sure = splats.opacity_logits.numpy() > 0
    assert 0.7 < sure.mean() < 1.0
    assert np.percentile(np.abs(off[sure]), 95) < 0.02


def test_photographs_that_match_nowhere_start_from_the_scene_box():
    config = ReconstructConfig()
    config = replace(config, seeding=replace(config.seeding, random_points=600))
    blank = add_priors(photographed(AROUND, blank=True), PriorsConfig(stereo=replace(SMALL, side_px=48)))
    splats = seed(blank, list(range(6)), config)
    assert len(splats) == 600


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"planes": 20}, r"StereoConfig\.planes is 20: needs a multiple of 16"),
        ({"side_px": 16}, r"StereoConfig\.side_px is 16: needs 32 to 8192"),
        ({"near_m": 3.0, "far_m": 2.0}, r"StereoConfig\.near_m is 3: needs less than StereoConfig\.far_m \(2\)"),
        ({"neighbours": 1}, r"StereoConfig\.neighbours is 1: needs at least as many as StereoConfig\.agreeing \(2\)"),
    ],
)
def test_impossible_settings_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        StereoConfig(**settings)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a | {"neighbours": np.full((2, 1), 7, np.int32)}, "a neighbour is not among the photographs"),
        (lambda a: a | {"planes": 20}, "planes must be a multiple of 16"),
        (lambda a: a | {"costs": np.zeros((2, 5, 5), np.float32)}, "arrays must be"),
        (lambda a: a | {"last": 3}, "views must lie within"),
    ],
)
def test_the_kernel_refuses_what_does_not_fit(change, message):
    taken, _ = photos([camera([0, 0, 0], width=24, height=18), camera([0.1, 0, 0], width=24, height=18)])
    arrays = {name: np.zeros((2, 18, 24), np.float32) for name in ("inverse", "costs")}
    arguments = {"photos": taken, "first": 0, "last": 1, "neighbours": np.array([[1], [0]], np.int32), "planes": 16}
    arguments |= {"ranges": np.ones((2, 2), np.float32), "step_penalty": 0.1, "jump_penalty": 1.0}
    with pytest.raises(ValueError, match=message):
        _native.stereo_sweep(**change(arguments | arrays))


@pytest.mark.data
def test_a_benchmark_room_is_measured_by_photographs_alone(data_root):
    path = data_root / "bench/living/transforms_sparse.json"
    truth = load_capture(path, CaptureConfig(max_side_px=128))
    found = stereo_depths(truth, list(range(len(truth))), StereoConfig(side_px=128))
    errors = []
    for view, seen in found.items():
        true = truth[view].depth
        assert true is not None and true.shape == seen.depth.shape
        errors.append((seen.depth - true).abs() / true)
    errors = torch.stack(errors)
    known = torch.isfinite(errors)
    assert errors[known].median() < 0.02
    assert known.float().mean() > 0.35
