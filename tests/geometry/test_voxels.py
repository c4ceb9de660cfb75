import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from goc.geometry.voxels import (
    HALF,
    ball,
    cells_of,
    connected_parts,
    dilate,
    find_keys,
    neighbour_pairs,
    pack_cells,
    pack_offset,
    parts_of,
    sum_by_key,
    unpack_cells,
)

cells = st.lists(st.tuples(*[st.integers(-6, 6)] * 3), min_size=1, max_size=40)


def keys_of(these) -> np.ndarray:
    return np.unique(pack_cells(np.array(these, np.int64)))


@given(st.lists(st.tuples(*[st.integers(4 - HALF, HALF - 4)] * 3), min_size=1, max_size=20))
def test_packing_is_undone_by_unpacking(these):
    assert unpack_cells(pack_cells(np.array(these))).tolist() == [list(cell) for cell in these]


@given(st.tuples(*[st.integers(-99, 99)] * 3), st.tuples(*[st.integers(-3, 3)] * 3))
def test_steps_add(cell, step):
    there = np.array([cell]) + step
    assert pack_cells(np.array([cell])) + pack_offset(step) == pack_cells(there)


def test_far_cells_are_refused():
    with pytest.raises(ValueError, match="cells reach 1048573 from the origin; keys hold 1048572"):
        pack_cells(np.array([[0, HALF - 3, 0]]))


def test_cells_are_half_open():
    points = np.array([[0.0, 0.099, 0.1], [-0.001, -0.1, 0.2]])
    assert cells_of(points, 0.1).tolist() == [[0, 0, 1], [-1, -1, 2]]


def test_values_are_summed_by_key():
    keys, sums = sum_by_key(np.array([5, 2, 5]), np.array([[1.0, 0], [2, 2], [3, 4]]))
    assert keys.tolist() == [2, 5]
    assert sums.tolist() == [[2, 2], [4, 4]]


def test_nothing_sums_to_nothing():
    keys, sums = sum_by_key(np.zeros(0, np.int64), np.zeros((0, 2)))
    assert (len(keys), len(sums)) == (0, 0)
    assert find_keys(keys, np.array([3])).tolist() == [-1]


def test_keys_are_found_or_not():
    assert find_keys(np.array([2, 5, 9]), np.array([9, 1, 5, 10])).tolist() == [2, -1, 1, -1]


@pytest.mark.parametrize(("radius", "count"), [(1.0, 6), (1.5, 18), (1.8, 26), (2.0, 32)])
def test_balls_hold_the_cells_in_reach_nearest_first(radius, count):
    steps = ball(radius)
    lengths = [np.linalg.norm(step) for step in steps]
    assert len(steps) == len(set(steps)) == count
    assert lengths == sorted(lengths)
    assert lengths[-1] <= radius


@given(cells, st.sampled_from([1.0, 1.8, 2.3]))
def test_neighbours_are_those_of_brute_force(these, radius):
    keys = keys_of(these)
    at = unpack_cells(keys)
    gaps = np.linalg.norm(at[:, None] - at[None], axis=-1)
    expected = {(i, j) for i, j in np.argwhere((gaps <= radius) & (gaps > 0)).tolist() if i < j}
    first, second = neighbour_pairs(keys, radius)
    found = [tuple(sorted(pair)) for pair in zip(first.tolist(), second.tolist(), strict=True)]
    assert len(found) == len(set(found))
    assert set(found) == expected


def test_parts_count_in_the_order_of_their_first_nodes():
    assert connected_parts(6, np.array([4, 1]), np.array([0, 5])).tolist() == [0, 1, 2, 3, 0, 1]


def test_a_gap_parts_and_a_choice_leaves_out():
    keys = keys_of([(0, 0, 0), (1, 1, 1), (3, 1, 1), (4, 1, 1)])
    assert parts_of(keys, np.ones(4, bool), 1.8).tolist() == [0, 0, 1, 1]
    assert parts_of(keys, np.ones(4, bool), 2.0).tolist() == [0, 0, 0, 0]
    assert parts_of(keys, np.array([True, True, False, True]), 2.0).tolist() == [0, 0, -1, 1]


@given(cells, st.integers(1, 2))
def test_dilation_fills_the_cube_around_and_keeps_what_was_there(these, rounds):
    keys = keys_of(these)
    grown, values = dilate(keys, np.arange(len(keys)), rounds)
    at, was = unpack_cells(grown), unpack_cells(keys)
    reach = np.abs(at[:, None] - was[None]).max(-1)
    assert (reach.min(1) <= rounds).all()
    assert len(grown) == len({tuple(a + d) for a in was for d in np.ndindex(*[2 * rounds + 1] * 3)})
    assert values[find_keys(grown, keys)].tolist() == list(range(len(keys)))


def test_dilation_takes_the_nearest():
    keys = keys_of([(0, 0, 0), (3, 0, 0)])
    grown, values = dilate(keys, np.array([10, 20]), 1)
    nearest = dict(zip(map(tuple, unpack_cells(grown).tolist()), values.tolist(), strict=True))
    assert (nearest[1, 0, 0], nearest[2, 0, 0]) == (10, 20)
