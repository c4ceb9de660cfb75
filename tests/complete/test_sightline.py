"""Where a scan was seen from: one depth a ray, and points that are evenly dense."""

import numpy as np
import pytest

from goc.complete.sightline import find_viewpoint, sight_from, stands_apart
from scankinds import camera, can, mug, seen_from

EYE = (1.6, -1.9, 1.2)
UP = np.array([0.0, 0.0, 1.0])


def angle(a, b):
    return np.degrees(np.arccos(np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b)))


@pytest.mark.parametrize("thing", [can, mug])
def test_the_place_of_one_depth_image_is_found_by_its_density(thing):
    cloud = seen_from(thing, EYE)
    found = find_viewpoint(cloud.positions, None, None)
    assert found is not None and found[1] == "density"
    assert angle(found[0] - cloud.positions.mean(axis=0), EYE) < 12


def test_the_origin_of_a_camera_s_frame_is_found():
    cloud = seen_from(mug, EYE)
    local = ((cloud.positions - np.array(EYE)) @ camera(EYE).T).astype(np.float32)
    place, how = find_viewpoint(local, None, None)
    assert how == "origin" and not place.any()


def test_views_from_all_round_have_no_viewpoint():
    points = np.concatenate([seen_from(mug, (2.5 * np.cos(a), 2.5 * np.sin(a), 1.0)).positions for a in (0, 2.1, 4.2)])
    assert find_viewpoint(points, None, UP) is None
    assert not stands_apart(points, np.array(EYE))
    assert stands_apart(seen_from(mug, EYE).positions, np.array(EYE))


def test_points_spread_evenly_over_a_surface_have_no_viewpoint():
    """Half a ball: nothing hides from its front, yet the density tells that no sensor was there."""
    points = np.random.default_rng(0).normal(size=(12_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert find_viewpoint(points[points[:, 0] > 0].astype(np.float32), None, UP) is None


def test_a_place_among_the_points_is_none():
    points = seen_from(can, EYE).positions
    assert sight_from(points, np.zeros(3), 0.02) is None
    assert sight_from(points, np.array([0.0, 0.0, 0.6]), 0.02) is None
    seen = sight_from(points, np.array(EYE), 0.02)
    assert seen is not None and seen.hidden < 0.03
    behind = sight_from(points, -np.array(EYE), 0.02)
    assert behind is not None and behind.spread > 1.25 * seen.spread


def test_the_scan_s_own_normals_are_heard():
    points = seen_from(can, EYE).positions
    towards = np.array(EYE) - points
    normals = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    assert find_viewpoint(points, normals, UP) is not None
    assert find_viewpoint(points, -normals, UP) is None
