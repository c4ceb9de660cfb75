"""Volumes, overlaps and penetrations of solids in closed form."""

import numpy as np
import pytest

from assets import inside_out
from goc.evaluation.metrics import sample_surface
from goc.evaluation.volumes import RoomWalls, SolidMesh, intersection_over_union, penetration, wall_depth, wall_volume
from solids import cube, cuboid, joined, sphere, with_face_flipped

ROOM = RoomWalls(inside_out(cuboid((0, 0, 0), (4, 3, 2.5))))


def between(first, second):
    samples = [sample_surface(mesh, 20_000) for mesh in (first, second)]
    return penetration(SolidMesh(first), samples[0], SolidMesh(second), samples[1], seed=0)


def test_two_cubes_that_overlap():
    """A smaller cube sticks 0.1 deep in the side of a larger one."""
    found = between(cube(), cuboid((0.9, 0.2, 0.2), (1.9, 0.8, 0.8)))
    assert found.depth == pytest.approx(0.1, abs=1e-3)
    assert found.volume == pytest.approx(0.1 * 0.6 * 0.6, rel=1e-6)


def test_a_cube_inside_another():
    found = between(cube(), cube(0.2, (0.2, 0.4, 0.4)))
    assert found.depth == pytest.approx(0.4, abs=0.01)  # its far side is 0.4 inside
    assert found.volume == pytest.approx(0.008)


@pytest.mark.parametrize("shift", [1.0, 1.5])
def test_solids_apart_or_touching_do_not_penetrate(shift):
    found = between(cube(), cube(at=(shift, 0, 0)))
    assert (found.depth, found.volume) == (0.0, 0.0)


def test_shifted_cubes_share_what_they_should():
    assert intersection_over_union(SolidMesh(cube()), SolidMesh(cube(at=(0.5, 0, 0))), 0) == pytest.approx(
        1 / 3, abs=2e-3
    )
    assert intersection_over_union(SolidMesh(cube()), SolidMesh(cube()), 0) == 1.0
    assert intersection_over_union(SolidMesh(cube()), SolidMesh(cube(at=(3.0, 0, 0))), 0) == 0.0


def test_a_sphere_in_a_larger_one():
    small, large = SolidMesh(sphere(0.5, rings=60)), SolidMesh(sphere(1.0, rings=60))
    assert intersection_over_union(small, large, 0) == pytest.approx(0.125, abs=2e-3)


def test_overlapping_parts_count_once():
    both = SolidMesh(joined(cube(), cube(at=(0.5, 0.25, 0.25))))
    assert both.flaw is None and both.self_intersections > 0
    assert both.volume == pytest.approx(2 - 0.5 * 0.75 * 0.75, abs=5e-3)
    assert intersection_over_union(both, SolidMesh(cube()), 0) == pytest.approx(1 / (2 - 0.5 * 0.75**2), abs=5e-3)


def test_what_has_no_inside():
    assert not SolidMesh(with_face_flipped(cube())).has_inside
    assert not SolidMesh(inside_out(cube())).has_inside
    assert SolidMesh(cube()).has_inside


def test_how_far_something_is_in_the_floor():
    sunk = cuboid((1, 1, -0.02), (1.5, 1.5, 0.5))
    assert wall_depth(sample_surface(sunk, 20_000), ROOM) == pytest.approx(0.02, abs=1e-6)
    assert wall_volume(SolidMesh(sunk), ROOM, seed=0) == pytest.approx(0.02 * 0.25, rel=0.05)
    standing = cuboid((1, 1, 1e-4), (1.5, 1.5, 0.5))
    assert wall_depth(sample_surface(standing, 20_000), ROOM) == 0.0
    assert wall_volume(SolidMesh(standing), ROOM, seed=0) == 0.0


def test_solid_walls_count_like_an_inward_shell():
    floor = RoomWalls(cuboid((0, 0, -0.2), (4, 3, 0)))
    sunk = cuboid((1, 1, -0.02), (1.5, 1.5, 0.5))
    assert wall_depth(sample_surface(sunk, 20_000), floor) == pytest.approx(0.02, abs=1e-6)
    assert not floor.hold(np.array([[1.0, 1.0, 0.5], [9.0, 9.0, 9.0]])).any()
