"""Given depth against the splats': which is taken where, in a room of boxes whose depth is closed form."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from boxrooms import Pose, box_room, cube, orbit, table
from cameras import capture_of, pinhole, placed
from goc.events import ignore
from goc.extract import measured_views
from goc.extract.agreement import depth_gaps, measured_noise, views_noise
from goc.extract.measured_views import averaged, depth_errors, edge_blur
from goc.fusion import DepthNoise, Detail, FusionConfig, evidence_block_grid
from goc.scene import StoredFrames
from oracles.depth_gaps import depth_gaps as plain_depth_gaps

BOXES = {1: table(0.0, 0.7), 4: cube(0.15, 0.6, 0.72, 0.3)}
BIAS = 0.01


def with_depths(capture, change):
    frames = tuple(replace(frame, depth=change(index, frame.depth)) for index, frame in enumerate(capture))
    return replace(capture, frames=StoredFrames(frames))


@pytest.fixture(scope="module")
def exact():
    return box_room(BOXES, orbit(10), size=(80, 60))


@pytest.fixture(scope="module")
def shown(exact):
    """What splats would show: everything 1 cm too far."""
    return with_depths(exact, lambda _, depth: depth + BIAS)


@pytest.mark.parametrize(("aside", "gap"), [(0.0, 0.0), (0.3, 0.3), (-0.3, -0.3)])
def test_a_gap_is_the_distance_behind_along_z(aside, gap):
    camera = pinhole(pose=placed((0.2, 0.1, -0.5)))
    points = torch.tensor([[0.0, 0.0, 2.0], [0.1, -0.2, 2.0], [9.0, 0.0, 2.0], [0.0, 0.0, -3.0]])
    between, nearest = depth_gaps(points, camera, torch.full((48, 64), 2.5 + aside))
    assert between[:2].tolist() == pytest.approx([gap, gap], abs=1e-5)
    assert nearest[:2].tolist() == pytest.approx([gap, gap], abs=1e-5)
    assert between[2:].isnan().all() and nearest[2:].isnan().all()


def test_a_gap_at_an_edge_is_to_the_nearer_of_two_surfaces():
    depth = torch.full((48, 64), 2.0)
    depth[:, 32:] = 4.0
    between, nearest = depth_gaps(torch.tensor([[0.0, 0.1, 2.1]]), pinhole(), depth)
    assert between.isnan().all()
    assert nearest.item() == pytest.approx(-0.1, abs=1e-5)


def test_gaps_are_those_of_plain_arithmetic(exact):
    depth = exact[3].depth.clone()
    depth[::7] = torch.nan
    points = exact.cameras[0].unproject_depth(exact[0].depth)
    found = depth_gaps(points, exact.cameras[3], depth)
    expected = plain_depth_gaps(points, exact.cameras[3], depth, 0.03)
    for gap, plain in zip(found, expected, strict=True):
        assert 0.1 < plain.isfinite().float().mean() < 1.0
        assert gap.shape == plain.shape and (gap.isnan() == plain.isnan()).float().mean() > 0.999
        assert float((gap - plain).nan_to_num().abs().max()) < 1e-4


def test_noise_of_either_view_is_found_and_other_surfaces_are_not_noise():
    rng = np.random.default_rng(0)
    z = rng.uniform(0.5, 4.0, 40_000)
    gap = np.sqrt(2) * (0.002 + 0.003 * z**2) * rng.standard_normal(len(z))
    gap[::10] = 0.04 * z[::10]
    noise = measured_noise([torch.tensor(np.stack([z, gap]), dtype=torch.float32)])
    for depth in (1.0, 2.0, 3.5):
        assert float(noise.at(torch.tensor(depth))) == pytest.approx(0.002 + 0.003 * depth**2, rel=0.2)
    assert measured_noise([torch.zeros(2, 10)]) is None
    assert measured_noise([]) is None


def test_clean_depth_is_taken_as_it_is(exact, shown):
    found = measured_views(exact, shown)
    for index, frame in enumerate(found.views):
        same = (frame.depth - exact[index].depth).abs() < 1e-6
        assert same[exact[index].depth.isfinite()].float().mean() > 0.99
    assert found.metrics["given_depth_noise_m"] < 0.002
    assert found.metrics["given_depth_views_left_out"] == 0


def test_where_nothing_is_given_the_splats_speak(exact, shown):
    def holed(index, depth):
        return torch.where(torch.arange(80) < 20, torch.tensor(0.0 if index % 2 else torch.nan), depth)

    found = measured_views(with_depths(exact, holed), shown)
    for index, frame in enumerate(found.views):
        assert torch.equal(frame.depth[:, :20].nan_to_num(), shown[index].depth[:, :20].nan_to_num())


def test_a_view_without_depth_is_the_splats(exact, shown):
    frames = [replace(frame, depth=None) if index == 3 else frame for index, frame in enumerate(exact)]
    found = measured_views(replace(exact, frames=StoredFrames(tuple(frames))), shown)
    assert torch.equal(found.views[3].depth.nan_to_num(), shown[3].depth.nan_to_num())


def test_flying_pixels_are_the_splats(exact, shown):
    flying = torch.zeros(60, 80, dtype=torch.bool)
    flying[10:50:7, 10:70:7] = True
    noisy = with_depths(exact, lambda index, depth: torch.where(flying, 0.6 * depth, depth) if index == 4 else depth)
    at = flying & exact[4].depth.isfinite()
    taken = measured_views(noisy, shown).views[4].depth[at]
    replaced = (taken - shown[4].depth[at]).abs() < 1e-6
    assert replaced.float().mean() > 0.8


def test_a_view_that_does_not_fit_is_the_splats(exact, shown):
    found = measured_views(with_depths(exact, lambda i, depth: 1.03 * depth if i == 5 else depth), shown)
    assert found.metrics["given_depth_views_left_out"] == 1
    assert torch.equal(found.views[5].depth.nan_to_num(), shown[5].depth.nan_to_num())


def test_noise_is_averaged_and_the_bias_of_splats_is_not_taken_over(exact, shown):
    noisy = box_room(BOXES, orbit(10), size=(80, 60), noise=0.02)
    found = measured_views(noisy, shown)
    assert found.metrics["given_depth_noise_m"] == pytest.approx(0.02, rel=0.3)
    error = torch.cat([(a.depth - b.depth).flatten() for a, b in zip(found.views, exact, strict=True)])
    error = error[error.isfinite()]
    assert error.median().abs() < 0.2 * BIAS
    assert 1.4826 * error.abs().median() < 0.4 * 0.02


def test_averaging_keeps_what_the_splats_show_and_stays_on_one_surface():
    slope = torch.linspace(1.0, 2.0, 12).expand(12, 12)
    given = slope + torch.where(torch.arange(12) < 6, 0.1, 0.4)
    trusted = torch.ones(12, 12, dtype=torch.bool)
    same = averaged(given, slope, trusted, torch.full((12, 12), 0.05))
    assert same == pytest.approx(given, abs=1e-6)
    nowhere = torch.full((12, 12), torch.nan)
    assert torch.equal(averaged(given, nowhere, trusted, torch.full((12, 12), 0.05)), given)


def test_ids_go_with_the_surface_whose_depth_is_taken(exact, shown):
    """Splats that show the cube 30 cm too near and too large would give its id to the room behind it."""
    frames = []
    for frame in shown:
        spread = frame.ids.clone()
        spread[:20], nearer = 4, frame.depth.clone()
        nearer[:20] -= 0.3
        frames.append(replace(frame, ids=spread, depth=nearer))
    found = measured_views(exact, replace(shown, frames=StoredFrames(tuple(frames))))
    for index, frame in enumerate(found.views):
        taken = (frame.depth - exact[index].depth).abs() < 1e-6
        assert (frame.ids[:20] == exact[index].ids[:20])[taken[:20]].all()
        assert (frame.ids[20:] == shown[index].ids[20:]).all()


def test_without_metric_depth_all_stays_with_the_splats(exact, shown):
    for capture in (replace(exact, depth_kind="affine"), replace(exact, has_depth=False)):
        found = measured_views(capture, shown, ignore)
        assert found.views is shown and not found.errors and not found.metrics


def test_too_little_overlap_to_judge_stays_with_the_splats(exact, shown):
    alone, drawn = capture_of([exact[0]]), capture_of([shown[0]])
    found = measured_views(alone, drawn)
    assert found.views is drawn and not found.metrics
    assert found.errors[1].median == pytest.approx(BIAS, abs=1e-5)


def test_the_error_of_splats_is_told_object_by_object(exact):
    def wrong(index, depth):
        return depth + torch.where(exact[index].ids == 4, 0.03, -0.002)

    errors = depth_errors(exact, with_depths(exact, wrong))
    assert errors[4].median == pytest.approx(0.03, abs=1e-5)
    assert errors[1].median == pytest.approx(-0.002, abs=1e-5)
    assert errors[4].mad < 1e-5 and errors[4].pixels > 20


def test_the_choice_scales_with_the_scene(exact, shown):
    """Law: a capture in other units makes the same choice."""
    scale = 7.0
    noisy = box_room(BOXES, orbit(10), size=(80, 60), noise=0.02)
    large = box_room(BOXES, orbit(10), Pose(np.eye(3), scale), noise=0.02, size=(80, 60))
    here = measured_views(noisy, shown)
    there = measured_views(large, with_depths(large, lambda index, _: scale * shown[index].depth))
    assert there.metrics["given_depth_noise_m"] == pytest.approx(here.metrics["given_depth_noise_m"], rel=1e-3)
    off = (there.views[2].depth / scale - here.views[2].depth).abs()
    assert (off[off.isfinite()] < 1e-4).float().mean() > 0.99


@pytest.mark.parametrize(
    ("footprint", "noise", "voxel", "band"),
    [
        (0.0, 0.0, 0.001, 0.002),
        (0.012, 0.0, 0.004, 0.008),
        (0.012, 0.003, 0.004, 0.009),
        (0.012, 0.006, 0.006, 0.018),
        (0.012, 0.060, 0.060, 0.180),
        (0.012, None, 0.004, 0.012),
    ],
)
def test_pixels_and_noise_set_voxels_and_bands(footprint, noise, voxel, band):
    detail, config = Detail(footprint=footprint, noise=noise), FusionConfig()
    assert detail.finest(config, 1.0) == pytest.approx(voxel)
    assert detail.band(voxel, config) == pytest.approx(band)


def test_evidence_is_never_finer_than_its_pixels_and_its_band_stays_wide():
    points, config = np.array([[0, 0, 0], [0.92, 0.5, 0.5]], np.float32), FusionConfig(object_voxel=1.0)

    def box(detail):
        return evidence_block_grid(points, 1.0, config, detail)

    assert box(None).voxel == pytest.approx(1.0 / 128)
    assert box(Detail(footprint=0.003, noise=0.0)).voxel == pytest.approx(1.0 / 128)
    assert box(Detail(footprint=0.060, noise=0.0)).voxel == pytest.approx(0.020)
    assert box(Detail(footprint=0.003, noise=0.015)).voxel == pytest.approx(0.015)
    assert box(Detail(footprint=0.003, noise=0.0)).truncation == pytest.approx(3.0 / 128)


def test_noise_grows_with_the_square_of_depth():
    noise = DepthNoise(floor=0.001, square=0.002)
    assert noise.at(torch.tensor([0.0, 1.0, 3.0])).tolist() == pytest.approx([0.001, 0.003, 0.019])


def test_the_noise_of_views_is_measured_where_it_is_not_told():
    clean = views_noise(box_room(BOXES, orbit(10), size=(80, 60)))
    rough = views_noise(box_room(BOXES, orbit(10), size=(80, 60), noise=0.01))
    assert float(rough.at(torch.tensor(2.0))) == pytest.approx(0.01, rel=0.3)
    assert float(clean.at(torch.tensor(2.0))) < 0.002
    assert views_noise(replace(box_room(BOXES, orbit(2), size=(40, 30)), has_depth=False)) is None


def test_blurred_edges_are_the_splats_and_sharp_ones_the_sensors(exact, shown):
    def blurred(_, depth):
        filled = depth.nan_to_num(4.0)[None, None]
        return torch.nn.functional.avg_pool2d(filled, 9, 1, 4, count_include_pad=False)[0, 0]

    assert edge_blur(exact, shown) == 0
    soft = with_depths(exact, blurred)
    assert edge_blur(soft, shown) >= 5
    found = measured_views(soft, shown)
    beside = (exact[2].depth[:, 1:] - exact[2].depth[:, :-1]).abs() > 0.3
    assert beside.sum() > 20
    taken = found.views[2].depth[:, 1:][beside]
    assert torch.equal(taken, shown[2].depth[:, 1:][beside])
