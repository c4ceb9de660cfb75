"""Ids of box rooms, spoiled in known ways, come back; what was right stays."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from boxrooms import box_room, cube, orbit, table
from cameras import capture_of
from goc.events import Warned
from goc.priors.consensus import repair_ids
from goc.priors.consensus.agreement import agreement
from goc.priors.consensus.relabel import relabelled
from goc.priors.segmentation import SegmentConfig
from goc.scene import ROOM, UNLABELLED

BOXES = {1: table(-0.7, 0.9), 2: cube(-0.9, 0.9, 0.72, 0.25), 3: cube(0.5, 0.8, 0.0, 0.5), 4: cube(1.0, 0.8, 0.0, 0.4)}
CONFIG = SegmentConfig(voxel_m=0.03)


@pytest.fixture(scope="module")
def room():
    return box_room(BOXES, orbit(20), size=(96, 72))


def truth_of(room):
    return np.stack([frame.ids.numpy() for frame in room])


def with_ids(room, ids, names=None):
    frames = [replace(frame, ids=torch.from_numpy(one.astype(np.int16))) for frame, one in zip(room, ids, strict=True)]
    return replace(capture_of(frames), id_names=names or {})


def random_ids(truth, seed=0):
    """Every view calls its objects something else."""
    rng = np.random.default_rng(seed)
    made = truth.copy()
    for one, out in zip(truth, made, strict=True):
        for key, new in zip((1, 2, 3, 4), rng.permutation(np.arange(1, 90))[:4], strict=True):
            out[one == key] = new
    return made


def spoiled_ids(truth):
    """A tenth swapped, a tenth dropped, object 3 in two halves and object 4 called 3 in a third of the views."""
    made = truth.copy()
    for index, (one, out) in enumerate(zip(truth, made, strict=True)):
        if index % 3 == 1:
            column = np.nonzero(one == 3)[1]
            out[(one == 3) & (np.arange(one.shape[1]) > np.median(column))] = 9
        if index % 3 == 2:
            out[one == 4] = 3
        if index % 10 == 3:
            out[one == 1], out[one == 2] = 2, 1
        if index % 10 == 6:
            out[one == 1] = UNLABELLED
        if index % 10 == 7:
            out[one == 2] = ROOM
    return made


def best_iou(truth, found, key):
    """Overlap of a true object over all views with the found id that fits best, and that id."""
    ids, counts = np.unique(found[truth == key], return_counts=True)
    best = ids[counts.argmax()]
    both = (truth == key) & (found == best)
    return both.sum() / ((truth == key) | (found == best)).sum(), int(best)


def repaired(capture, mode="repair"):
    heard = []
    fixed, report = repair_ids(capture, mode, CONFIG, heard.append)
    return truth_of(fixed), report, [event.message for event in heard if isinstance(event, Warned)], fixed


def test_ids_that_mean_nothing_between_views_come_back_as_objects(room):
    truth = truth_of(room)
    found, report, _, _ = repaired(with_ids(room, random_ids(truth)), "auto")
    assert report.repaired and not report.consistent and report.objects == 4
    matches = [best_iou(truth, found, key) for key in range(5)]
    assert min(iou for iou, _ in matches) > 0.98
    assert matches[0][1] == ROOM and len({best for _, best in matches}) == 5


def test_the_room_is_found_by_its_planes_where_no_id_says_it(room):
    truth = truth_of(room)
    given = random_ids(truth)
    given[truth == ROOM] = 95
    found, _, _, _ = repaired(with_ids(room, given))
    assert best_iou(truth, found, ROOM) == (pytest.approx(1.0, abs=0.02), ROOM)
    assert min(best_iou(truth, found, key)[0] for key in (1, 2, 3, 4)) > 0.95


def test_swapped_dropped_split_and_merged_masks_come_back(room):
    truth = truth_of(room)
    capture = with_ids(room, spoiled_ids(truth), {0: "room", 1: "table", 3: "crate", 9: "ghost"})
    found, report, told, fixed = repaired(capture, "auto")
    matches = [best_iou(truth, found, key) for key in range(5)]
    assert [best for _, best in matches] == [0, 1, 2, 3, 4], "objects keep the ids that most of their masks had"
    assert min(iou for iou, _ in matches) > 0.95
    assert fixed.id_names == {0: "room", 1: "table", 3: "crate"}
    faults = report.faults
    assert faults["swaps"].count >= 4 and faults["drops"].count == 4
    assert faults["merges"].count >= 5 and faults["splits"].count >= 5
    assert faults["drops"].views == tuple(room.view_names[index] for index in (6, 7, 16))
    assert len(told) == 5 and "masks of objects were missing, first in" in " ".join(told)
    assert report.metrics["ids_drops"] == 4 and report.metrics["ids_agreement"] < 0.95


def test_consistent_ids_are_kept_as_they_are_and_repairing_them_changes_nothing(room):
    same, report, told, fixed = repaired(room, "auto")
    assert fixed is room and not report.repaired and report.agreement == pytest.approx(1.0, abs=0.005) and not told
    found, report, _, _ = repaired(room, "repair")
    assert (found == same).mean() > 0.999 and all(fault.count == 0 for fault in report.faults.values())


def test_keep_trusts_what_is_given(room):
    capture = with_ids(room, random_ids(truth_of(room)))
    assert repair_ids(capture, "keep", CONFIG)[0] is capture
    bare = replace(capture, has_depth=False)
    assert repair_ids(bare, "repair", CONFIG)[0] is bare


def test_the_order_of_views_does_not_matter_and_runs_repeat(room):
    capture = with_ids(room, spoiled_ids(truth_of(room)))
    order = np.random.default_rng(3).permutation(len(capture))
    shuffled = replace(
        capture_of([capture[int(i)] for i in order]), view_names=tuple(capture.view_names[int(i)] for i in order)
    )
    first = repaired(capture)[0]
    np.testing.assert_array_equal(repaired(capture)[0], first)
    np.testing.assert_array_equal(repaired(shuffled)[0], first[order])


def test_agreement_counts_objects_and_not_the_room(room):
    truth = truth_of(room)
    half = truth.copy()
    half[::2][truth[::2] == 3] = 8
    assert agreement(room) == pytest.approx(1.0, abs=0.005)
    assert agreement(with_ids(room, random_ids(truth))) < 0.1
    assert 0.3 < agreement(with_ids(room, half)) < 0.98
    assert agreement(with_ids(room, np.zeros_like(truth))) is None


def test_right_masks_keep_their_outline_and_merged_ones_are_parted_by_their_surface():
    given = np.array([[1, 1, 1, 1, 1, 1, -1, 5]], np.int16)
    surface = np.array([[4, 4, 4, -1, 7, 7, 7, -1]], np.int16)
    # Mask 1 holds 4 and most of 7, its pixel without a surface goes to the larger; 7 is a third outside; 5 is known.
    np.testing.assert_array_equal(relabelled(given, surface, {5: 2}), [[4, 4, 4, 4, 7, 7, -1, 2]])
    rim = np.array([[1, 1, 1, 1, 1, 2, 2, 2]], np.int16)
    below = np.array([[4, 4, 4, 4, 7, 7, 7, 7]], np.int16)
    np.testing.assert_array_equal(relabelled(rim, below, {}), [[4, 4, 4, 4, 4, 7, 7, 7]])
