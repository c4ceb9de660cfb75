import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from goc.geometry.planes import Plane, along, find_plane, fit_plane, plane_inliers, refine_plane, robust_sigma

UP = np.array([0.0, 0.0, 1.0])


def sheet(normal: np.ndarray, offset: float, count: int, seed: int, noise: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (count, 3))
    points -= np.outer(points @ normal - offset, normal)
    return points + noise * rng.standard_normal((count, 1)) * normal


@given(st.integers(0, 1000))
def test_a_plane_is_fitted_exactly(seed):
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    plane = fit_plane(sheet(normal, 0.7, 40, seed), normal)
    assert plane.normal == pytest.approx(normal, abs=1e-9)
    assert plane.offset == pytest.approx(0.7, abs=1e-9)


def test_the_normal_turns_to_the_side_asked_for():
    points = sheet(UP, 0.3, 20, 0)
    below = fit_plane(points, -UP)
    assert below.normal == pytest.approx(-UP)
    assert below.offset == pytest.approx(-0.3)
    assert below.distance(np.zeros((1, 3))) == pytest.approx([0.3])


def test_two_points_make_no_plane():
    with pytest.raises(ValueError, match="a plane needs 3 points, not 2"):
        fit_plane(np.zeros((2, 3)), UP)


def test_dot_products_are_dot_products():
    points = np.random.default_rng(0).standard_normal((50, 3))
    assert along(points, points[0]) == pytest.approx(points @ points[0])


def test_inliers_are_near_and_face_the_same_way():
    points = np.array([[0, 0, 0.0], [0, 0, 0.2], [0, 0, 0.05], [5, 5, -0.05]])
    normals = np.array([UP, UP, -UP, UP])
    assert plane_inliers(Plane(UP, 0.0), points, normals, 0.1).tolist() == [True, False, False, True]


def test_ransac_finds_the_largest_of_three_sheets_among_clutter():
    rng = np.random.default_rng(5)
    sheets = [(UP, 0.0, 900), (np.array([1.0, 0, 0]), 0.9, 500), (np.array([0, 0.6, 0.8]), -0.2, 300)]
    points = np.concatenate([sheet(n, d, k, i, 0.004) for i, (n, d, k) in enumerate(sheets)])
    normals = np.concatenate([np.tile(n, (k, 1)) for n, _, k in sheets])
    clutter = rng.standard_normal((500, 3))
    points = np.concatenate([points, rng.uniform(-1, 1, (500, 3))])
    normals = np.concatenate([normals, clutter / np.linalg.norm(clutter, axis=1, keepdims=True)])
    found = find_plane(points, normals, 0.012, np.random.default_rng(0))
    assert found.normal == pytest.approx(UP, abs=3e-3)
    assert found.offset == pytest.approx(0.0, abs=1e-3)


def test_ransac_is_repeatable():
    points, normals = sheet(UP, 0.1, 300, 1, 0.01), np.tile(UP, (300, 1))
    first, second = (find_plane(points, normals, 0.02, np.random.default_rng(7)) for _ in range(2))
    assert (first.normal == second.normal).all()
    assert first.offset == second.offset


@pytest.mark.parametrize("count", [0, 2])
def test_too_few_points_have_no_plane(count):
    assert find_plane(np.zeros((count, 3)), np.tile(UP, (count, 1)), 0.1, np.random.default_rng(0)) is None


def test_refinement_leaves_a_plane_without_inliers_alone():
    plane = Plane(UP, 9.0)
    assert refine_plane(plane, np.zeros((5, 3)), np.tile(UP, (5, 1)), 0.1) is plane


def test_spread_is_the_standard_deviation_and_ignores_outliers():
    values = np.random.default_rng(0).standard_normal(20_000) * 0.02
    values[:500] = 100.0
    assert robust_sigma(values) == pytest.approx(0.02, rel=0.06)
    assert robust_sigma(np.zeros(0)) == 0.0
