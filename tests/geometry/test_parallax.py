"""Neighbours come from poses: near enough to match, far enough to measure, looking at the same things."""

import numpy as np

from cameras import looking_at, pinhole, ring
from goc.geometry.parallax import parallax_views
from goc.scene import Camera


def on_arc(degrees: list[float]) -> list[Camera]:
    return [pinhole(60.0, pose=pose) for pose in ring(np.deg2rad(degrees))]


def test_the_best_neighbour_looks_from_ten_degrees_away():
    found = parallax_views(on_arc([0, 1, 10, 40, 80]), 2.0, 2)
    assert found[0, 0] == 2


def test_neighbours_look_from_different_sides():
    found = parallax_views(on_arc([0, 9, 10, 11, -12]), 2.0, 2)
    assert found[0, 0] in (1, 2, 3)
    assert found[0, 1] == 4


def test_a_view_is_not_its_own_neighbour_nor_is_one_that_looks_away():
    views = [*on_arc([0, 10]), pinhole(60.0, pose=looking_at([2.0, 0.1, 0.0], [4.0, 0.1, 0.0]))]
    found = parallax_views(views, 2.0, 3)
    assert found[0].tolist() == [1, -1, -1]
    assert found[2].tolist() == [-1, -1, -1]


def test_neighbours_do_not_depend_on_the_unit():
    small, large = on_arc([0, 5, 11, 20, 33]), on_arc([0, 5, 11, 20, 33])
    for view in large:
        view.world_from_cam[:3, 3] *= 100.0
    assert (parallax_views(small, 2.0, 4) == parallax_views(large, 200.0, 4)).all()
