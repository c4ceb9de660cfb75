"""Planes: fits move with their points, scale with their unit, and know their front."""

import numpy as np
import pytest

from goc.geometry.planes import Plane, along, find_plane, fit_plane, plane_inliers, refine_plane, robust_sigma
from laws import MOTIONS, SCALES, close, only, over

SHAPES = {
    "three points": np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "square": np.array([[x, y, 0.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]),
    "strip": np.stack([np.linspace(-3, 3, 50), 0.01 * np.cos(np.arange(50)), np.zeros(50)], 1),
    "cloud": np.concatenate([np.random.default_rng(0).uniform(-1, 1, (400, 2)), np.zeros((400, 1))], 1),
}
"""Points with z = 0."""


def moved(points: np.ndarray, motion: np.ndarray, scale: float = 1.0) -> np.ndarray:
    return scale * (points @ motion[:3, :3].T + motion[:3, 3])


@over(points=SHAPES, motion=MOTIONS, scale=SCALES)
def test_a_fit_moves_and_scales_with_its_points(points, motion, scale):
    normal = motion[:3, 2]
    plane = fit_plane(moved(points, motion, scale), normal)
    close(plane.normal, normal, ulps=1e8)  # the axis of an eigenvector: errors are square roots of the matrix's
    size = scale * (1 + np.abs(motion[:3, 3]).max())
    assert plane.offset == pytest.approx(scale * normal @ motion[:3, 3], abs=1e-7 * size)
    assert np.abs(plane.distance(moved(points, motion, scale))).max() < 1e-7 * size
    ahead = moved(points + [0, 0, 0.5], motion, scale)
    np.testing.assert_allclose(plane.distance(ahead), 0.5 * scale, atol=1e-7 * size)


@over(points=SHAPES, motion=MOTIONS)
def test_the_other_side_is_the_same_plane_turned_round(points, motion):
    at = moved(points, motion)
    front, back = fit_plane(at, motion[:3, 2]), fit_plane(at, -motion[:3, 2])
    close(front.normal, -back.normal)
    assert front.offset == pytest.approx(-back.offset, abs=1e-12)
    close(front.distance(at + 1), -back.distance(at + 1), size=10)


@over(points=only(SHAPES, "square", "cloud"), scale=SCALES)
def test_inliers_do_not_depend_on_the_unit(points, scale):
    random = np.random.default_rng(1)
    noisy = points + [0, 0, 1] * random.normal(0, 0.1, (len(points), 1))
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    near = plane_inliers(Plane(np.array([0.0, 0, 1]), 0.0), noisy, normals, 0.1)
    far = plane_inliers(Plane(np.array([0.0, 0, 1]), 0.0), scale * noisy, normals, 0.1 * scale)
    assert np.array_equal(near, far)
    assert not plane_inliers(Plane(np.array([0.0, 0, 1]), 0.0), noisy, -normals, 0.1).any()


@over(motion=MOTIONS, scale=SCALES)
def test_ransac_finds_the_same_plane_wherever_it_stands(motion, scale):
    random = np.random.default_rng(2)
    sheet = np.concatenate([random.uniform(-1, 1, (300, 2)), random.normal(0, 0.002, (300, 1))], 1)
    points = np.concatenate([sheet, random.uniform(-1, 1, (100, 3))])
    stray = random.normal(size=(100, 3))
    normals = np.concatenate([np.tile([0.0, 0, 1], (300, 1)), stray / np.linalg.norm(stray, axis=1, keepdims=True)])
    found = find_plane(moved(points, motion, scale), normals @ motion[:3, :3].T, 0.01 * scale, np.random.default_rng(3))
    assert found.normal @ motion[:3, 2] > 1 - 1e-4
    assert found.offset == pytest.approx(scale * motion[:3, 2] @ motion[:3, 3], abs=0.01 * scale)


@over(points=only(SHAPES, "square", "strip", "cloud"))
def test_refining_what_fits_changes_nothing(points):
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    plane = fit_plane(points, normals[0])
    refined = refine_plane(plane, points, normals, 0.01)
    close(refined.normal, plane.normal)
    assert refined.offset == pytest.approx(plane.offset, abs=1e-12)


@over(scale=SCALES)
def test_spread_scales_and_ignores_signs_and_order(scale):
    values = np.random.default_rng(4).normal(size=501)
    assert robust_sigma(scale * values) == pytest.approx(scale * robust_sigma(values))
    assert robust_sigma(-values[::-1]) == robust_sigma(values)
    assert robust_sigma(np.full(7, scale)) == pytest.approx(1.4826 * scale)


@over(motion=MOTIONS)
def test_dot_products_are_linear_and_invariant(motion):
    random = np.random.default_rng(5)
    points, direction = random.normal(size=(30, 3)), random.normal(size=3)
    close(along(2 * points + direction, direction), 2 * along(points, direction) + direction @ direction, size=20)
    close(along(points @ motion[:3, :3].T, motion[:3, :3] @ direction), along(points, direction), size=20)
