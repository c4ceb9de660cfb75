"""Scans of four kinds of things, one view each with noise and nothing typed, come out as what they are."""

import numpy as np
import pytest

from goc.complete import ScanConfig, complete_scan
from goc.geometry.raycast import TriangleScene
from oracles.watertight import signed_volume, trouble
from scankinds import bare, bowl, camera, can, chair, mug, seen_from

EYE = (1.4, -1.7, 1.5)


def overlap(mesh, thing):
    """Volume in both over volume in either, of a closed mesh and a thing."""
    places = np.random.default_rng(0).uniform(-0.8, 0.8, (20_000, 3))
    inside, true = TriangleScene(mesh.vertices, mesh.faces).winding(places) > 0, thing(places) < 0
    return (inside & true).sum() / (inside | true).sum()


def inside(mesh, place):
    return TriangleScene(mesh.vertices, mesh.faces).winding(np.array([place], np.float64))[0] > 0


@pytest.mark.parametrize(
    ("thing", "least", "solid", "empty"),
    [
        (can, 0.6, (0, 0, 0), (0, 0, 0.7)),
        (bowl, 0.3, (0.293, -0.355, -0.06), (0, 0, -0.1)),
        (mug, 0.3, (0, 0, -0.45), (-0.1, 0.12, 0.35)),
        (chair, 0.2, (0, 0, 0), (-0.1, 0, 0.3)),
    ],
)
def test_a_thing_seen_once_comes_out_as_what_it_is(thing, least, solid, empty):
    done = complete_scan(seen_from(thing, EYE), ScanConfig(cells=48))
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    assert any("one depth image" in words for words in done.assumed)
    assert overlap(done.mesh, thing) > least
    assert inside(done.mesh, solid) and not inside(done.mesh, empty)


def test_in_the_camera_s_frame_the_same_comes_out_turned():
    cloud = seen_from(mug, EYE)
    local = (cloud.positions - np.array(EYE)) @ camera(EYE).T
    done = complete_scan(bare(local), ScanConfig(method="convex", cells=32))
    same = complete_scan(cloud, ScanConfig(method="convex", cells=32, viewpoint=(EYE,)))
    assert any("the origin" in words for words in done.assumed) and done.up[1] == -1
    volumes = [signed_volume(one.mesh.vertices, one.mesh.faces) for one in (done, same)]
    assert volumes[0] == pytest.approx(volumes[1], rel=0.15)


def test_points_that_come_twice_change_nothing():
    """Clouds filled up to a fixed count repeat most of their points: the distance to the nearest is 0 then."""
    cloud = seen_from(can, EYE)
    twice = bare(np.concatenate([cloud.positions, cloud.positions]))
    heard = []
    done, same = (
        complete_scan(one, ScanConfig(method="convex", cells=24, viewpoint=(EYE,)), heard.append)
        for one in (twice, cloud)
    )
    assert heard == []
    np.testing.assert_array_equal(done.mesh.vertices, same.mesh.vertices)


def test_nothing_is_filled_in_below_what_a_thing_stands_on():
    cloud = seen_from(can, EYE)
    config = ScanConfig(method="hull", cells=32, viewpoint=(EYE,))
    free = complete_scan(cloud, config)
    table = np.random.default_rng(0).uniform(-1.0, 1.0, (4000, 3)) * [1, 1, 0] + [0, 0, -0.5]
    table = table[np.hypot(table[:, 0], table[:, 1]) > 0.3]
    both = bare(np.concatenate([cloud.positions, table]))
    given = complete_scan(
        cloud, ScanConfig(method="hull", cells=32, viewpoint=(EYE,), support_plane=(0.0, 0.0, 2.0, 1.0))
    )
    found = complete_scan(both, ScanConfig(method="hull", cells=32, viewpoint=(EYE,), find_support=True))
    assert free.mesh.vertices[:, 2].min() < -0.6
    assert given.mesh.vertices[:, 2].min() > -0.57 and found.mesh.vertices[:, 2].min() > -0.57
    assert np.abs(found.mesh.vertices[:, :2]).max() < 0.7
    assert any("stands on a plane that" in words for words in found.assumed)


def test_two_viewpoints_leave_less_unknown_than_one():
    eyes = ((1.4, -1.7, 1.5), (-1.9, 1.4, 1.2))
    cloud = bare(np.concatenate([seen_from(can, eye).positions for eye in eyes]))
    both, one = (
        complete_scan(cloud, ScanConfig(method="hull", cells=32, viewpoint=places)) for places in (eyes, eyes[:1])
    )
    volumes = [signed_volume(each.mesh.vertices, each.mesh.faces) for each in (both, one)]
    assert volumes[0] < volumes[1]
    assert overlap(both.mesh, can) > 0.75
