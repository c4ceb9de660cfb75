"""Voxel keys: packing is a bijection that keeps order and steps; sums and parts do not depend on order."""

import numpy as np
import pytest

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
from laws import SCALES, over

RIM = HALF - 4


def _cells(seed: int, reach: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(-reach, reach + 1, (count, 3))


CELLS = {
    "none": np.zeros((0, 3), np.int64),
    "origin": np.zeros((1, 3), np.int64),
    "corners of the range": np.array([[x, y, z] for x in (-RIM, RIM) for y in (-RIM, RIM) for z in (-RIM, RIM)]),
    "row": np.stack([np.arange(-9, 9), np.zeros(18, int), np.zeros(18, int)], 1),
    "dense": np.argwhere(np.ones((5, 4, 3), bool)) - 2,
    "sparse": _cells(0, 40, 60),
    "clumps": np.concatenate([_cells(1, 3, 40), _cells(2, 3, 40) + [50, 0, 0], _cells(3, 2, 20) - [0, 90, 7]]),
    "anywhere": _cells(4, RIM, 50),
    "narrow integers": _cells(5, 100, 30).astype(np.int32),
}


def keys_of(cells: np.ndarray) -> np.ndarray:
    return np.unique(pack_cells(cells))


@over(cells=CELLS)
def test_packing_is_undone_and_distinct(cells):
    keys = pack_cells(cells)
    assert keys.dtype == np.int64 and (keys >= 0).all()
    np.testing.assert_array_equal(unpack_cells(keys), cells)
    assert len(np.unique(keys)) == len(np.unique(cells, axis=0))


@over(cells=CELLS)
def test_keys_sort_as_cells_do_from_the_last_axis(cells):
    np.testing.assert_array_equal(np.argsort(pack_cells(cells), kind="stable"), np.lexsort(cells.T))


@over(cells=CELLS)
@pytest.mark.parametrize("step", [(1, 0, 0), (0, -1, 0), (-1, 2, 3), (3, -3, 3)])
def test_steps_are_differences_of_keys(cells, step):
    np.testing.assert_array_equal(unpack_cells(pack_cells(cells) + pack_offset(step)), cells + np.array(step))
    assert pack_offset(tuple(-s for s in step)) == -pack_offset(step)


@over(scale=SCALES)
def test_cells_scale_with_their_voxels(scale):
    points = np.random.default_rng(6).uniform(-4, 4, (200, 3))
    clear = (np.abs(points / 0.25 - np.rint(points / 0.25)) > 1e-6).all(1)  # roundings may put a rim on either side
    np.testing.assert_array_equal(cells_of(scale * points, scale * 0.25)[clear], cells_of(points, 0.25)[clear])
    corner = cells_of(points, 0.25) * 0.25
    assert ((points - corner >= -1e-12) & (points - corner < 0.25 + 1e-12)).all()


@over(cells=CELLS)
def test_sums_by_key_keep_the_total_and_count_each_key_once(cells):
    keys = np.repeat(pack_cells(cells), 3)
    values = np.random.default_rng(7).integers(0, 100, (len(keys), 2)).astype(float)
    unique, sums = sum_by_key(keys, values)
    np.testing.assert_array_equal(unique, np.unique(keys))
    np.testing.assert_array_equal(sums.sum(0), values.sum(0))
    order = np.random.default_rng(8).permutation(len(keys))
    again, shuffled = sum_by_key(keys[order], values[order])
    np.testing.assert_array_equal(again, unique)
    np.testing.assert_array_equal(shuffled, sums)


@over(cells=CELLS)
def test_every_key_is_found_at_its_row_and_no_other_is(cells):
    keys = keys_of(cells)
    np.testing.assert_array_equal(find_keys(keys, keys), np.arange(len(keys)))
    absent = np.setdiff1d(keys + 1, keys)
    assert (find_keys(keys, absent) == -1).all()


@pytest.mark.parametrize("radius", [0.0, 1.0, 1.5, 1.8, 2.0, 3.3])
def test_balls_are_symmetric_and_grow(radius):
    steps = set(ball(radius))
    assert {tuple(-s for s in step) for step in steps} == steps
    assert {tuple(step[i] for i in (1, 2, 0)) for step in steps} == steps
    assert steps <= set(ball(radius + 0.5)) and (0, 0, 0) not in steps


@over(cells=CELLS)
@pytest.mark.parametrize("radius", [1.0, 1.8, 2.5])
def test_neighbours_do_not_depend_on_where_the_cells_are(cells, radius):
    near = cells.astype(np.int64) if len(cells) == 0 else cells.astype(np.int64) - cells.min(0)
    if np.abs(near).max(initial=0) > RIM - 40:
        near = near // 4
    keys, shifted = keys_of(near), keys_of(near + [11, -7, 30])
    for here, there in zip(neighbour_pairs(keys, radius), neighbour_pairs(shifted, radius), strict=True):
        np.testing.assert_array_equal(here, there)
    first, second = neighbour_pairs(keys, radius)
    gaps = np.linalg.norm(unpack_cells(keys)[first] - unpack_cells(keys)[second], axis=1)
    assert ((gaps > 0) & (gaps <= radius)).all()


@over(cells=CELLS)
def test_parts_partition_the_chosen_and_merge_as_steps_get_longer(cells):
    keys = keys_of(cells)
    chosen = np.arange(len(keys)) % 4 != 3
    fine, coarse = parts_of(keys, chosen, 1.0), parts_of(keys, chosen, 2.5)
    assert ((fine >= 0) == chosen).all() and ((coarse >= 0) == chosen).all()
    for part in np.unique(fine[chosen]):
        assert len(np.unique(coarse[fine == part])) == 1
    assert set(fine[chosen]) == set(range(fine.max(initial=-1) + 1))


@pytest.mark.parametrize("seed", range(4))
def test_parts_are_those_of_repeated_spreading(seed):
    random = np.random.default_rng(seed)
    firsts, seconds = random.integers(0, 30, (2, 22))
    names = np.arange(30)
    for _ in range(30):
        least = np.minimum(names[firsts], names[seconds])
        np.minimum.at(names, firsts, least)
        np.minimum.at(names, seconds, least)
    parts = connected_parts(30, firsts, seconds)
    _, expected = np.unique(names, return_inverse=True)  # a part is named for its first node
    np.testing.assert_array_equal(parts, expected)


@over(cells=CELLS)
def test_dilating_twice_is_dilating_by_two(cells):
    near = cells.astype(np.int64) % 1000
    keys = keys_of(near)
    once = dilate(keys, np.arange(len(keys)), 1)
    twice, direct = dilate(*once, 1), dilate(keys, np.arange(len(keys)), 2)
    for a, b in zip(twice, direct, strict=True):
        np.testing.assert_array_equal(a, b)
    still = dilate(keys, np.arange(len(keys)), 0)
    np.testing.assert_array_equal(still[0], keys)


@pytest.mark.parametrize("axis", range(3))
def test_cells_beyond_the_range_are_refused(axis):
    cell = np.zeros((1, 3), np.int64)
    cell[0, axis] = -(RIM + 1)
    with pytest.raises(ValueError, match=f"cells reach {RIM + 1} from the origin; keys hold {RIM}"):
        pack_cells(cell)
