"""What is near, inside and crossed: closed forms, and the brute-force twins."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from assets import inside_out
from goc import _native
from goc.geometry.raycast import TriangleScene
from oracles import proximity as oracle
from solids import cube, joined, moved, sphere, unwelded


def scene(mesh):
    return TriangleScene(mesh.vertices, mesh.faces)


def soup(seed, triangles, size=0.5):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-2, 2, (triangles, 1, 3)) + rng.normal(0, size, (triangles, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), triangles=st.sampled_from([1, 3, 5, 40]))
def test_distances_equal_the_twin(seed, triangles):
    vertices, faces = soup(seed, triangles)
    points = np.random.default_rng(seed + 1).uniform(-3, 3, (20, 3))
    expected = np.array([[oracle.distance(point, vertices[face]) for face in faces] for point in points])
    found, triangle = TriangleScene(vertices, faces).nearest(points)
    np.testing.assert_allclose(found, expected.min(axis=1), atol=1e-9)
    np.testing.assert_allclose(expected[np.arange(20), triangle], expected.min(axis=1), atol=1e-9)
    limited, which = TriangleScene(vertices, faces).nearest(points, 0.5)
    near = expected.min(axis=1) <= 0.5
    np.testing.assert_array_equal(np.isfinite(limited), near)
    np.testing.assert_array_equal(which >= 0, near)
    np.testing.assert_array_equal(limited[near], found[near])


def test_distances_to_a_cube():
    points = np.array([[0.5, 0.5, 1.25], [2.0, 0.5, 0.5], [2.0, 2.0, 2.0], [0.5, 0.5, 0.4], [1.0, 1.0, 1.0]])
    found, _ = scene(cube()).nearest(points, np.array([1.0, 1.0, 2.0, 1.0, 0.0]))
    np.testing.assert_allclose(found, [0.25, 1.0, np.sqrt(3), 0.4, 0.0], atol=1e-12)


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_winding_numbers_equal_solid_angles(seed):
    rng = np.random.default_rng(seed)
    parts = [sphere(rng.uniform(0.4, 1.2), rng.uniform(-0.5, 0.5, 3), rings=4) for _ in range(3)]
    mesh = joined(*parts[:2], inside_out(parts[2]))
    points = rng.uniform(-1.5, 1.5, (60, 3))
    expected = np.array([oracle.winding(point, mesh.vertices, mesh.faces) for point in points])
    np.testing.assert_array_equal(scene(mesh).winding(points), np.rint(expected).astype(int))
    np.testing.assert_allclose(expected, np.rint(expected), atol=1e-6)


def test_winding_counts_overlaps_and_rooms():
    both = joined(cube(), cube(at=(0.5, 0.0, 0.0)))
    points = np.array([[0.25, 0.5, 0.5], [0.75, 0.5, 0.5], [1.25, 0.5, 0.5], [2.0, 0.5, 0.5]])
    assert scene(both).winding(points).tolist() == [1, 2, 1, 0]
    assert scene(inside_out(cube())).winding(points).tolist() == [-1, -1, 0, 0]


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), triangles=st.sampled_from([2, 6, 30]))
def test_crossings_equal_the_twin(seed, triangles):
    vertices, faces = soup(seed, triangles, size=1.0)
    pairs = oracle.crossing_pairs(vertices, faces)
    expected = np.bincount(np.array(pairs, int).ravel(), minlength=len(faces))
    np.testing.assert_array_equal(TriangleScene(vertices, faces).crossings(), expected)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_crossings_with_common_corners_equal_the_twin(seed):
    """Triangles over few corners share many of them, on a lattice many planes too."""
    rng = np.random.default_rng(seed)
    vertices = rng.integers(0, 4, (9, 3)).astype(np.float32)
    faces = np.array([rng.permutation(9)[:3] for _ in range(14)], np.int32)
    areas = np.linalg.norm(
        np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]), axis=1
    )
    faces = faces[areas > 0.5]
    if len(faces) == 0:
        return
    expected = np.bincount(np.array(oracle.crossing_pairs(vertices, faces), int).ravel(), minlength=len(faces))
    np.testing.assert_array_equal(TriangleScene(vertices, faces).crossings(), expected)


@pytest.mark.parametrize("mesh", [cube(), sphere(), unwelded(sphere()), joined(cube(), cube(at=(1.0, 0.3, 0.0)))])
def test_solids_and_solids_that_touch_do_not_cross(mesh):
    assert scene(mesh).crossings().sum() == 0


def test_a_bow_tie_crosses_itself_once():
    """Two triangles through each other; a third with a common corner that folds through the first."""
    vertices = np.array([(-1, -1, 0), (1, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1), (0, -3, 0.0)], np.float32)
    assert TriangleScene(vertices, np.array([(0, 1, 2), (3, 4, 5)], np.int32)).crossings().tolist() == [1, 1]
    fold = np.array([(-1, -1, 0), (1, -1, 0), (0, 1, 0), (0, -0.5, -1), (0, -0.5, 1)], np.float32)
    assert TriangleScene(fold, np.array([(0, 1, 2), (2, 3, 4)], np.int32)).crossings().tolist() == [1, 1]
    beside = moved(cube(), (0, 0, 0))
    cut = joined(beside, cube(at=(0.5, 0.5, 0.5)))
    pairs = oracle.crossing_pairs(cut.vertices, cut.faces)
    assert scene(cut).crossings().sum() == 2 * len(pairs) > 0


def test_results_do_not_depend_on_threads():
    vertices, faces = soup(3, 2000)
    points = np.random.default_rng(0).uniform(-3, 3, (3000, 3))
    before = _native.thread_count()
    found = []
    try:
        for threads in (1, 3):
            _native.set_thread_count(threads)
            many = TriangleScene(vertices, faces)
            found.append((*many.nearest(points), many.winding(points), many.crossings()))
    finally:
        _native.set_thread_count(before)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_bad_points_and_limits_are_refused():
    with pytest.raises(ValueError, match="need finite points"):
        scene(cube()).nearest(np.array([[0.0, np.nan, 0.0]]))
    with pytest.raises(ValueError, match="need finite points"):
        scene(cube()).winding(np.array([[np.inf, 0.0, 0.0]]))
    with pytest.raises(ValueError, match="a limit is negative or NaN"):
        scene(cube()).nearest(np.zeros((1, 3)), -1.0)
