"""Shares of surface with the right id, where they can be counted by hand."""

import numpy as np
import pytest

from goc.evaluation.labels import label_accuracy, label_recall, nearest_id
from goc.evaluation.metrics import sample_surface
from goc.geometry.raycast import TriangleScene
from solids import cube, cuboid, joined


def scene(mesh):
    return TriangleScene(mesh.vertices, mesh.faces)


FIRST, SECOND = cube(), cube(at=(3.0, 0, 0))
TRUTH = {0: scene(cuboid((-5, -5, -2.2), (9, 5, -2))), 1: scene(FIRST), 2: scene(SECOND)}


def points(mesh):
    return sample_surface(mesh, 4000).points


def test_perfect_surfaces_are_right():
    assert label_accuracy(points(FIRST), 1, TRUTH) == 1.0
    assert label_recall(points(FIRST), 1, TRUTH, {1: TRUTH[1], 2: TRUTH[2]}) == 1.0


def test_surface_of_another_object_is_wrong():
    """The prediction of 1 took half of what is 2's."""
    both = points(joined(FIRST, SECOND))
    assert label_accuracy(both, 1, TRUTH) == pytest.approx(0.5, abs=0.01)
    assert label_accuracy(points(SECOND), 1, TRUTH) == 0.0


def test_swapped_ids_recall_nothing():
    assert label_recall(points(FIRST), 1, TRUTH, {1: TRUTH[2], 2: TRUTH[1]}) == 0.0


def test_a_missing_object_recalls_nothing_and_a_distant_one_neither():
    assert label_recall(points(FIRST), 1, TRUTH, {2: TRUTH[2]}) == 0.0
    near, far = (scene(cuboid((-g, -g, -g), (1 + g, 1 + g, 1 + g))) for g in (0.015, 0.025))
    assert label_recall(points(FIRST), 1, TRUTH, {1: near}) == 1.0
    assert label_recall(points(FIRST), 1, TRUTH, {1: far}) == 0.0


def test_where_objects_meet_nothing_is_counted():
    """A cube that stands on another: the face between them may carry either id."""
    truth = {1: scene(FIRST), 2: scene(cube(at=(0, 0, 1.0)))}
    between = np.array([[0.5, 0.5, 1.0], [0.2, 0.7, 1.005]])
    assert np.isnan(label_accuracy(between, 1, truth))
    assert np.isnan(label_recall(between, 1, truth, truth))
    # Taking the lid for its own costs the share of the other four sides and the top that it took.
    assert label_accuracy(np.array([[0.5, 0.5, 1.0], [0.5, 0.5, 0.0], [0.5, 0.5, 2.0]]), 1, truth) == 0.5


def test_the_nearest_of_all():
    assert nearest_id(points(SECOND), TRUTH) == 2
    assert nearest_id(np.array([[0.0, 0, -1.9]]), TRUTH) == 0
