"""Metrics in cases whose answer is known."""

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from goc.evaluation.metrics import SurfaceSamples, psnr, sample_surface, ssim, surface_scores
from goc.scene import Mesh


def square(height=0.0, side=1.0, shift=0.0):
    corners = [(shift, 0, height), (shift + side, 0, height), (shift + side, side, height), (shift, side, height)]
    return Mesh(vertices=np.array(corners, np.float32), faces=np.array([(0, 1, 2), (0, 2, 3)], np.int32))


def test_samples_are_uniform_over_area_and_repeatable():
    mesh = Mesh(  # one triangle nine times as large as the other
        vertices=np.array([(0, 0, 0), (3, 0, 0), (0, 3, 0), (5, 0, 1), (6, 0, 1), (5, 1, 1)], np.float32),
        faces=np.array([(0, 1, 2), (3, 4, 5)], np.int32),
    )
    samples = sample_surface(mesh, 5000, seed=3)
    assert (samples.points[:, 2] > 0.5).mean() == pytest.approx(0.1, abs=0.001)
    large = samples.points[samples.points[:, 2] < 0.5]
    assert (large[:, :2] >= 0).all() and (large[:, 0] + large[:, 1] <= 3 + 1e-9).all()
    np.testing.assert_allclose(large[:, :2].mean(axis=0), [1.0, 1.0], atol=0.05)
    np.testing.assert_allclose(samples.normals, [[0, 0, 1]] * 5000, atol=1e-12)
    assert np.array_equal(samples.points, sample_surface(mesh, 5000, seed=3).points)
    assert not np.array_equal(samples.points, sample_surface(mesh, 5000, seed=4).points)


def test_faces_without_area_get_no_samples():
    mesh = square()
    flat = Mesh(vertices=mesh.vertices, faces=np.array([(0, 0, 1), (0, 1, 2), (2, 2, 2)], np.int32))
    assert np.isfinite(sample_surface(flat, 100).normals).all()


@pytest.mark.parametrize("faces", [np.zeros((0, 3), np.int32), np.array([(0, 0, 0)], np.int32)])
def test_a_mesh_without_area_is_refused(faces):
    with pytest.raises(ValueError, match="has no area to sample"):
        sample_surface(Mesh(vertices=np.zeros((1, 3), np.float32), faces=faces), 10)


def test_parallel_squares_are_their_distance_apart():
    scores = surface_scores(sample_surface(square(0.03), 20_000), sample_surface(square(), 20_000, seed=1))
    assert scores.accuracy == pytest.approx(0.03, abs=2e-3)
    assert scores.completion == pytest.approx(0.03, abs=2e-3)
    assert scores.chamfer == pytest.approx((scores.accuracy + scores.completion) / 2)
    assert scores.f_score[0.05] > 0.999 and scores.f_score[0.01] == 0.0
    assert scores.normal_consistency == pytest.approx(1.0)


def test_half_a_square_is_precise_but_half_recalled():
    whole = sample_surface(square(), 20_000)
    half = Mesh(vertices=square().vertices * np.array([0.5, 1, 1], np.float32), faces=square().faces)
    seen = whole.points[:, 0] < 0.5
    scores = surface_scores(sample_surface(half, 20_000, seed=1), whole, thresholds=(0.02,), seen=seen)
    recall = 0.52
    assert scores.f_score[0.02] == pytest.approx(2 * recall / (1 + recall), abs=0.01)
    assert scores.completion_seen < 0.006
    assert scores.completion_unseen == pytest.approx(0.25, abs=0.01)
    assert scores.accuracy < 0.006


def test_normals_at_right_angles_are_inconsistent():
    flat = sample_surface(square(), 2000)
    turned = SurfaceSamples(points=flat.points, normals=np.tile([1.0, 0, 0], (2000, 1)))
    assert surface_scores(turned, flat).normal_consistency == 0.0


def test_rigid_motion_changes_nothing():
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])

    def moved(samples):
        return SurfaceSamples(points=samples.points @ turn.T + [1.0, -2, 3], normals=samples.normals @ turn.T)

    a, b = sample_surface(square(0.02, shift=0.3), 3000), sample_surface(square(), 3000, seed=1)
    here, there = surface_scores(a, b), surface_scores(moved(a), moved(b))
    assert here.accuracy == pytest.approx(there.accuracy) and here.completion == pytest.approx(there.completion)
    assert here.f_score == pytest.approx(there.f_score)
    assert here.normal_consistency == pytest.approx(there.normal_consistency)


def test_a_missing_object_is_a_failure():
    scores = surface_scores(None, sample_surface(square(), 100))
    assert scores.f_score == {0.05: 0.0, 0.01: 0.0} and scores.normal_consistency == 0.0
    assert np.isnan(scores.accuracy) and scores.completion == scores.chamfer == float("inf")


def test_psnr_of_a_known_error():
    image = torch.rand(20, 30, 3)
    assert psnr(image, (image + 0.1)) == pytest.approx(20.0, abs=1e-4)
    assert psnr(image, image) == float("inf")


def test_ssim_is_what_wang_et_al_compute():
    generator = torch.Generator().manual_seed(0)
    truth = torch.rand(40, 50, 3, generator=generator)
    image = (truth + 0.2 * torch.rand(40, 50, 3, generator=generator)).clamp(0, 1)
    expected = structural_similarity(
        image.double().numpy(),
        truth.double().numpy(),
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1.0,
        channel_axis=2,
    )
    assert ssim(image, truth) == pytest.approx(expected, abs=1e-6)
    assert ssim(truth, truth) == pytest.approx(1.0)


def test_ssim_of_a_tiny_image_is_refused():
    with pytest.raises(ValueError, match="needs 11x11 pixels or more, not 10x40"):
        ssim(torch.zeros(10, 40, 3), torch.zeros(10, 40, 3))
