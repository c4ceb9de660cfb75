"""The choice of neighbouring views: it depends neither on the world's frame and unit nor on the order of the views."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cameras import looking_at, pinhole
from goc.geometry.neighbours import PairLimits, neighbour_views
from goc.geometry.parallax import parallax_views
from goc.scene import Camera
from laws import MOTIONS, SCALES, only, over

LIMITS = PairLimits(max_angle_deg=40.0, min_baseline=0.05, max_baseline=1.5, depths=(1.0, 2.0, 3.0), min_overlap=0.3)


def path(count=14, seed=0) -> list[Camera]:
    """Views of the same corner from places that no two pairs of have equal angles."""
    random = np.random.default_rng(seed)
    places = np.stack(
        [random.uniform(-1, 1, count), random.uniform(-2.6, -1.8, count), random.uniform(0.3, 1.4, count)], 1
    )
    targets = random.uniform(-0.4, 0.4, (count, 3))
    return [pinhole(60.0, pose=looking_at(place, target)) for place, target in zip(places, targets, strict=True)]


def carried(camera: Camera, motion: np.ndarray, scale: float) -> Camera:
    pose = motion @ camera.world_from_cam.double().numpy()
    pose[:3, 3] *= scale
    return replace(camera, world_from_cam=torch.from_numpy(pose).float())


def in_unit(limits: PairLimits, scale: float) -> PairLimits:
    return replace(
        limits,
        min_baseline=scale * limits.min_baseline,
        max_baseline=scale * limits.max_baseline,
        depths=tuple(scale * depth for depth in limits.depths),
    )


@over(motion=only(MOTIONS, "shift", "half turn", "any"), scale=SCALES)
def test_neighbours_depend_on_neither_frame_nor_unit(motion, scale):
    here, there = path(), [carried(camera, motion, scale) for camera in path()]
    found = neighbour_views(here, range(14), 4, LIMITS)
    assert found == neighbour_views(there, range(14), 4, in_unit(LIMITS, scale))
    assert sum(map(len, found.values())) > 14


@over(motion=only(MOTIONS, "shift", "half turn", "any"), scale=SCALES)
def test_parallax_depends_on_neither_frame_nor_unit(motion, scale):
    there = [carried(camera, motion, scale) for camera in path()]
    np.testing.assert_array_equal(parallax_views(there, 2.2 * scale, 5), parallax_views(path(), 2.2, 5))


@pytest.mark.parametrize("seed", range(4))
def test_renumbering_the_views_renumbers_the_answers(seed):
    cameras = path(seed=seed)
    order = np.random.default_rng(seed).permutation(14).tolist()
    shuffled = [cameras[i] for i in order]
    plain, other = (neighbour_views(views, range(14), 4, LIMITS) for views in (cameras, shuffled))
    assert {order[view]: tuple(order[n] for n in found) for view, found in other.items()} == plain
    rows, moved = parallax_views(cameras, 2.2, 5), parallax_views(shuffled, 2.2, 5)
    names = np.append(order, -1)
    np.testing.assert_array_equal(names[moved], rows[order])


@pytest.mark.parametrize("count", [0, 1, 3, 30])
def test_fewer_neighbours_are_the_first_of_more(count):
    cameras = path()
    all_found = neighbour_views(cameras, range(14), 13, LIMITS)
    for view, found in neighbour_views(cameras, range(14), count, LIMITS).items():
        assert found == all_found[view][:count] and view not in found
    most = parallax_views(cameras, 2.2, 13)
    np.testing.assert_array_equal(parallax_views(cameras, 2.2, min(count, 13)), most[:, : min(count, 13)])


@pytest.mark.parametrize(
    "wider", [{"max_angle_deg": 80.0}, {"max_baseline": 5.0}, {"min_baseline": 0.0}, {"min_overlap": 0.1}]
)
def test_wider_limits_keep_every_pair(wider):
    cameras = path()
    narrow = neighbour_views(cameras, range(14), 13, LIMITS)
    wide = neighbour_views(cameras, range(14), 13, replace(LIMITS, **wider))
    assert all(set(narrow[view]) <= set(wide[view]) for view in narrow)


def test_rows_of_parallax_name_each_view_once():
    for row, found in enumerate(parallax_views(path(), 2.2, 13)):
        named = found[found >= 0]
        assert len(set(named.tolist())) == len(named) and row not in named
        assert (found[len(named) :] == -1).all()


def test_one_view_has_no_neighbours():
    assert neighbour_views(path(1), [0], 4, LIMITS) == {0: ()}
    assert parallax_views(path(1), 2.0, 3).tolist() == [[-1, -1, -1]]
