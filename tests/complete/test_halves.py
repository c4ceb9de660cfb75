"""Scans that end in an upright plane, and the half that is missing."""

import numpy as np
import pytest

from goc.complete import ScanConfig, complete_scan
from goc.complete.copies import with_copy
from goc.complete.halves import find_cut, other_half
from goc.complete.scan_points import with_normals
from oracles.watertight import signed_volume, trouble
from scankinds import bare

UP = np.array([0.0, 0.0, 1.0])


def box_points(count, sides, seed=0):
    """Points on a box round the origin, evenly spread."""
    random = np.random.default_rng(seed)
    sides = np.array(sides)
    areas = np.repeat([sides.prod() / side for side in sides], 2)
    face = random.choice(6, count, p=areas / areas.sum())
    points = random.uniform(-0.5, 0.5, (count, 3)) * sides
    points[np.arange(count), face // 2] = np.where(face % 2, 0.5, -0.5) * sides[face // 2]
    return points


def turned(points, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def test_half_a_box_cut_askew_is_turned_and_not_mirrored():
    whole = turned(box_points(16_000, (1.0, 0.6, 0.5)), 30)
    half = with_normals(bare(whole[whole[:, 0] > 0]), ())
    copy = other_half(half, UP, find_cut(half, UP))
    assert copy is not None and copy.name == "half turn"
    np.testing.assert_allclose(copy.image(np.array([[0.2, 0.1, 0.1]])), [[-0.2, -0.1, 0.1]], atol=0.03)
    both = with_copy(half, copy)
    assert len(both.positions) == 2 * len(half.positions)
    outwards = np.sign((both.normals * both.positions).sum(axis=1))
    assert (outwards > 0).mean() > 0.98


def test_half_of_what_only_a_mirror_mends_is_mirrored():
    """An L, cut where its two equal arms meet as in a mirror: turned, it would not join."""
    low, high = box_points(9000, (1.0, 0.8, 0.2)), box_points(5000, (0.3, 0.8, 0.5), seed=1) + [0.35, 0, 0.35]
    whole = np.concatenate([low, high])
    half = with_normals(bare(whole[whole[:, 1] > 0]), ())
    copy = other_half(half, UP, find_cut(half, UP))
    assert copy is not None and copy.name == "mirror image"
    np.testing.assert_allclose(copy.image(np.array([[0.3, 0.2, 0.1]])), [[0.3, -0.2, 0.1]], atol=0.03)


def test_a_scan_that_ends_nowhere_or_below_is_no_half():
    points = box_points(8000, (1.0, 0.6, 0.5))
    assert find_cut(with_normals(bare(points), ()), UP) is None
    assert find_cut(with_normals(bare(points[points[:, 2] > -0.2]), ()), UP) is None


@pytest.mark.parametrize(("copies", "share"), [(True, 1.0), (False, 0.5)])
def test_half_a_box_becomes_a_whole_one(copies, share):
    points = box_points(9000, (1.0, 0.6, 0.5))
    cloud = bare(points[points[:, 0] > 0] + [3.0, 1.0, 0.0])
    done = complete_scan(cloud, ScanConfig(method="smooth", cells=24, copies=copies, find_viewpoint=False))
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    assert signed_volume(done.mesh.vertices, done.mesh.faces) == pytest.approx(0.3 * share, rel=0.2)
    assert any("half a thing" in words for words in done.assumed) == copies
    assert done.observed[done.mesh.vertices[:, 0] < 2.9].sum() == 0
