"""Scores of surfaces and images: identity, symmetry, motions, units, order, and monotony."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from goc.evaluation.metrics import SurfaceSamples, psnr, sample_surface, ssim, surface_scores
from laws import MOTIONS, SCALES, SOLIDS, only, over

THRESHOLDS = (0.01, 0.03, 0.1, 0.3)
SHAPES = {name: sample_surface(mesh, 800, seed=1) for name, mesh in SOLIDS.items() if name != "far cube"}
OTHERS = {name: sample_surface(SOLIDS[name], 600, seed=2) for name in ("cube", "ball", "ring")}


def moved(samples: SurfaceSamples, motion: np.ndarray, scale=1.0) -> SurfaceSamples:
    turn = motion[:3, :3].T
    return SurfaceSamples(points=scale * (samples.points @ turn + motion[:3, 3]), normals=samples.normals @ turn)


@over(a=SHAPES)
def test_a_surface_agrees_with_itself(a):
    scores = surface_scores(a, a, THRESHOLDS)
    assert scores.accuracy == scores.completion == scores.chamfer == 0.0
    assert scores.f_score == scores.precision == scores.recall == dict.fromkeys(THRESHOLDS, 1.0)
    assert scores.normal_consistency == pytest.approx(1.0)


@over(a=SHAPES, b=OTHERS)
def test_exchanging_the_sides_exchanges_precision_and_recall(a, b):
    forth, back = surface_scores(a, b, THRESHOLDS), surface_scores(b, a, THRESHOLDS)
    assert forth.accuracy == back.completion and forth.completion == back.accuracy
    assert forth.precision == back.recall and forth.recall == back.precision
    assert forth.chamfer == pytest.approx(back.chamfer) and forth.f_score == pytest.approx(back.f_score)
    assert forth.normal_consistency == pytest.approx(back.normal_consistency)


@over(a=SHAPES, b=OTHERS)
def test_scores_grow_with_the_threshold_and_f_lies_between(a, b):
    scores = surface_scores(a, b, THRESHOLDS)
    for name in ("f_score", "precision", "recall"):
        values = [getattr(scores, name)[t] for t in THRESHOLDS]
        assert values == sorted(values) and values[0] >= 0 and values[-1] <= 1
    for t in THRESHOLDS:
        low, high = sorted((scores.precision[t], scores.recall[t]))
        assert low - 1e-12 <= scores.f_score[t] <= high + 1e-12
    assert scores.chamfer == pytest.approx((scores.accuracy + scores.completion) / 2)


@over(a=only(SHAPES, "plate", "ball", "two parts"), b=OTHERS, motion=MOTIONS, scale=SCALES)
def test_motion_changes_nothing_and_the_unit_scales_lengths(a, b, motion, scale):
    here = surface_scores(a, b, THRESHOLDS)
    there = surface_scores(moved(a, motion, scale), moved(b, motion, scale), tuple(scale * t for t in THRESHOLDS))
    assert there.accuracy == pytest.approx(scale * here.accuracy, rel=1e-6)
    assert there.completion == pytest.approx(scale * here.completion, rel=1e-6)
    assert list(there.f_score.values()) == pytest.approx(list(here.f_score.values()), abs=2e-3)
    assert there.normal_consistency == pytest.approx(here.normal_consistency, abs=2e-3)


@over(a=SHAPES)
@pytest.mark.parametrize("seed", range(2))
def test_the_order_of_samples_says_nothing(a, seed):
    order = np.random.default_rng(seed).permutation(len(a))
    shuffled = SurfaceSamples(points=a.points[order], normals=a.normals[order])
    here, there = surface_scores(a, OTHERS["cube"]), surface_scores(shuffled, OTHERS["cube"])
    assert there.accuracy == pytest.approx(here.accuracy) and there.completion == pytest.approx(here.completion)
    assert there.f_score == pytest.approx(here.f_score)


@over(a=SHAPES)
def test_the_side_of_a_normal_says_nothing(a):
    turned = replace(a, normals=-a.normals)
    assert surface_scores(turned, a).normal_consistency == pytest.approx(1.0)


@over(a=SHAPES, b=OTHERS)
def test_more_prediction_never_hurts_completion_and_splits_add_up(a, b):
    both = SurfaceSamples(points=np.concatenate([a.points, b.points]), normals=np.concatenate([a.normals, b.normals]))
    alone, more = surface_scores(a, b, THRESHOLDS), surface_scores(both, b, THRESHOLDS)
    assert more.completion <= alone.completion and more.completion == 0.0
    seen = b.points[:, 0] > np.median(b.points[:, 0])
    split = surface_scores(a, b, THRESHOLDS, seen=seen)
    whole = seen.mean() * split.completion_seen + (~seen).mean() * split.completion_unseen
    assert whole == pytest.approx(split.completion)


@over(scale=SCALES)
def test_a_shift_along_the_normal_is_the_distance(scale):
    grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0], indexing="ij"), -1).reshape(-1, 3)
    flat = SurfaceSamples(points=scale * grid, normals=np.tile([0.0, 0, 1], (400, 1)))
    above = replace(flat, points=flat.points + [0, 0, 0.25 * scale])
    scores = surface_scores(above, flat, (0.2 * scale, 0.3 * scale))
    assert scores.accuracy == scores.completion == pytest.approx(0.25 * scale)
    assert list(scores.f_score.values()) == [0.0, 1.0]


IMAGES = {
    "flat": torch.full((24, 31, 3), 0.5),
    "ramp": torch.linspace(0, 1, 24 * 31 * 3).reshape(24, 31, 3),
    "noise": torch.rand(24, 31, 3, generator=torch.Generator().manual_seed(0)),
    "edge": torch.cat([torch.zeros(24, 15, 3), torch.ones(24, 16, 3)], 1),
}


@over(image=IMAGES, other=IMAGES)
def test_likeness_of_images_is_symmetric_and_bounded(image, other):
    assert ssim(image, other) == pytest.approx(ssim(other, image), abs=1e-9)
    assert psnr(image, other) == pytest.approx(psnr(other, image))
    assert -1 - 1e-9 <= ssim(image, other) <= 1 + 1e-9 and psnr(image, other) > 0


@over(image=IMAGES)
@pytest.mark.parametrize("error", [0.01, 0.1, 0.25])
def test_an_even_error_has_the_psnr_of_its_size_and_flips_do_not_matter(image, error):
    assert psnr(image + error, image) == pytest.approx(-20 * np.log10(error), abs=1e-3)
    noisy = image + error * torch.randn(image.shape, generator=torch.Generator().manual_seed(1))
    assert psnr(noisy.flip(0, 1), image.flip(0, 1)) == pytest.approx(psnr(noisy, image))
    assert ssim(noisy.flip(0), image.flip(0)) == pytest.approx(ssim(noisy, image), abs=1e-9)


@over(image=only(IMAGES, "ramp", "noise", "edge"))
def test_more_noise_is_less_alike(image):
    noise = torch.randn(image.shape, generator=torch.Generator().manual_seed(2))
    levels = [0.0, 0.02, 0.1, 0.4]
    likeness = [ssim(image + level * noise, image) for level in levels]
    ratios = [psnr(image + level * noise, image) for level in levels]
    assert likeness == sorted(likeness, reverse=True) and ratios == sorted(ratios, reverse=True)
    assert likeness[0] == pytest.approx(1.0) and ratios[0] == np.inf
