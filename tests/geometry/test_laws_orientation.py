"""Normals of bare points: closed shapes look outwards, whatever their place, unit, order and number of parts."""

import numpy as np
import pytest

from goc.geometry.orientation import point_normals
from goc.geometry.surfaces import surface_cloud
from laws import MOTIONS, SCALES, SOLIDS, only, over
from solids import sphere

BULGING = {
    "ball": surface_cloud(sphere(rings=40), 700),
    "egg": surface_cloud(sphere(rings=40), 900),
    "ring": surface_cloud(SOLIDS["ring"], 2500),
    "two balls": surface_cloud(sphere(rings=40), 600),
}
"""Points on closed surfaces with their true normals."""


def shape(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Points and true normals, float64."""
    cloud = BULGING[name]
    points, normals = cloud.positions.astype(np.float64), cloud.normals.astype(np.float64)
    if name == "egg":
        points, normals = points * [1, 1, 1.6], normals / [1, 1, 1.6]
    if name == "two balls":
        points, normals = np.concatenate([points, 0.5 * points + [4, 0, 0]]), np.concatenate([normals, normals])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


NAMES = {name: name for name in BULGING}


@over(name=NAMES, motion=only(MOTIONS, "still", "any", "another"))
def test_closed_shapes_look_outwards_wherever_they_are(name, motion):
    points, truth = shape(name)
    found = point_normals(points @ motion[:3, :3].T + motion[:3, 3])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-5)
    cosines = (found * (truth @ motion[:3, :3].T)).sum(1)
    assert (cosines > 0).all() and np.median(cosines) > 0.98


@over(name=NAMES, scale=SCALES)
def test_the_unit_says_nothing(name, scale):
    points, _ = shape(name)
    np.testing.assert_allclose(point_normals(scale * points), point_normals(points), atol=2e-3)


@over(name=only(NAMES, "ball", "two balls"))
@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_the_points_says_nothing(name, seed):
    points, _ = shape(name)
    order = np.random.default_rng(seed).permutation(len(points))
    np.testing.assert_allclose(point_normals(points[order]), point_normals(points)[order], atol=1e-3)


@pytest.mark.parametrize("neighbours", [4, 8, 30])
def test_a_plane_has_one_normal_whatever_the_neighbourhood(neighbours):
    flat = np.concatenate([np.random.default_rng(0).uniform(-1, 1, (300, 2)), np.full((300, 1), 0.7)], 1)
    normals = point_normals(flat, neighbours)
    np.testing.assert_allclose(np.abs(normals[:, 2]), 1.0, atol=1e-5)
    parts = {4: 0.8, 8: 1.0, 30: 1.0}[neighbours]  # few neighbours leave islands, each with a side of its own
    assert max((normals[:, 2] > 0).mean(), (normals[:, 2] < 0).mean()) >= parts


@pytest.mark.parametrize("count", [0, 3])
def test_too_few_points_are_refused(count):
    with pytest.raises(ValueError, match=f"{count} points say nothing of a surface: four is the least"):
        point_normals(np.zeros((count, 3)))
