"""Labels and matching: shares do not depend on frame, order or names; the assignment is the best of all."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from goc.evaluation.labels import label_accuracy, label_recall, nearest_id
from goc.evaluation.matching import match_by_id, match_by_shape
from goc.evaluation.metric_format import METRICS, NOTHING
from goc.evaluation.metrics import sample_surface, surface_scores
from goc.evaluation.truth import TrueObject, Truth
from goc.geometry.raycast import TriangleScene
from goc.scene import Mesh
from laws import MOTIONS, carried, only, over, relabelled
from solids import cube, cuboid, moved, sphere

OBJECTS = {1: cube(), 2: cube(at=(1.6, 0.0, 0.0)), 3: sphere(0.5, (0.5, 2.2, 0.5))}
ROOM = cuboid((-3.0, -3.0, -1.0), (5.0, 5.0, -0.5))
PREDICTED = {1: cube(1.015), 2: moved(OBJECTS[2], (0.005, 0, 0)), 3: cube(0.9, (0.05, 1.75, 0.05))}


def scenes(meshes: dict[int, Mesh]) -> dict[int, TriangleScene]:
    return {id: TriangleScene(mesh.vertices, mesh.faces) for id, mesh in meshes.items()}


def points(mesh: Mesh, seed=0) -> np.ndarray:
    return sample_surface(mesh, 1500, seed).points


def shares(truth: dict[int, Mesh], predicted: dict[int, Mesh]) -> list[float]:
    true, guessed = scenes(truth), scenes(predicted)
    accuracy = [label_accuracy(points(predicted[id]), id, true) for id in predicted]
    return accuracy + [label_recall(points(truth[id]), id, true, guessed) for id in predicted]


@over(motion=only(MOTIONS, "shift", "half turn", "any"))
def test_shares_do_not_depend_on_the_frame(motion):
    truth = {0: ROOM, **OBJECTS}
    there = [{id: carried(mesh, motion) for id, mesh in meshes.items()} for meshes in (truth, PREDICTED)]
    assert shares(*there) == pytest.approx(shares(truth, PREDICTED), abs=0.01)


@pytest.mark.parametrize("renamed", [{1: 7, 2: 1, 3: 2}, {1: 3, 2: 2, 3: 1}])
def test_shares_do_not_depend_on_names_or_on_how_meshes_are_indexed(renamed):
    truth = {0: ROOM} | {renamed[id]: mesh for id, mesh in OBJECTS.items()}
    predicted = {renamed[id]: mesh for id, mesh in PREDICTED.items()}
    assert shares(truth, predicted) == pytest.approx(shares({0: ROOM, **OBJECTS}, PREDICTED))
    shuffled = {id: relabelled(mesh, id) for id, mesh in truth.items()}
    guessed = scenes(predicted)
    for id in predicted:
        at = points(truth[id])
        assert label_recall(at, id, scenes(shuffled), guessed) == label_recall(at, id, scenes(truth), guessed)


def test_more_competitors_never_raise_a_share():
    truth = scenes({0: ROOM, **OBJECTS})
    at = points(PREDICTED[3])
    alone = label_accuracy(at, 3, {3: truth[3]})
    assert alone == 1.0 and label_accuracy(at, 3, truth) <= alone
    few, many = {3: scenes(PREDICTED)[3]}, scenes({**PREDICTED, 9: sphere(0.5, (0.5, 2.2, 0.5))})
    assert label_recall(points(OBJECTS[3]), 3, truth, many) <= label_recall(points(OBJECTS[3]), 3, truth, few)


def test_of_equal_surfaces_every_point_is_ambiguous():
    twins = scenes({1: OBJECTS[1], 2: OBJECTS[1]})
    assert np.isnan(label_accuracy(points(OBJECTS[1]), 1, twins))
    assert np.isnan(label_recall(points(OBJECTS[1]), 1, twins, twins))


@pytest.mark.parametrize("id", [1, 2, 3])
def test_the_nearest_id_is_its_own(id):
    assert nearest_id(points(PREDICTED[id]), scenes({0: ROOM, **OBJECTS})) == id


def truth_of(objects: dict[int, Mesh], tmp_path) -> Truth:
    samples = {id: sample_surface(mesh, 4000, 50 + id) for id, mesh in objects.items()}
    return Truth(
        folder=tmp_path,
        objects={id: TrueObject(samples=one, seen=np.ones(len(one), bool)) for id, one in samples.items()},
        seen=samples[1],
        seen_ids=np.ones(len(samples[1]), np.int64),
        labels={1: "crate"},
    )


@pytest.mark.parametrize("order", list(itertools.permutations((11, 12, 13))))
def test_shapes_are_matched_whatever_they_are_called(tmp_path, order):
    predicted = dict(sorted(zip(order, PREDICTED.values(), strict=True)))
    assert match_by_shape(predicted, truth_of(OBJECTS, tmp_path), seed=0) == dict(zip((1, 2, 3), order, strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_the_assignment_has_the_greatest_sum_of_all(tmp_path, seed):
    random = np.random.default_rng(seed)
    objects = {id: cube(1.0, (1.02 * id, 0, 0)) for id in (1, 2, 3)}
    predicted = {id: cube(1.0, (1.02 * id + random.normal(0, 0.02), random.normal(0, 0.02), 0)) for id in (4, 5, 6, 7)}
    predicted = {id: moved(mesh, (-3.06, 0, 0)) for id, mesh in predicted.items()}
    truth = truth_of(objects, tmp_path)
    found = match_by_shape(predicted, truth, seed=0)
    clouds = {id: sample_surface(mesh, 4000, 0) for id, mesh in predicted.items()}

    def worth(pairs) -> float:
        return sum(surface_scores(clouds[p], truth.objects[t].samples, (0.05,)).f_score[0.05] for t, p in pairs)

    best = max(worth(zip((1, 2, 3), chosen, strict=True)) for chosen in itertools.permutations(predicted, 3))
    assert worth(found.items()) == pytest.approx(best, abs=0.02)


def test_what_is_far_or_empty_is_matched_with_nothing(tmp_path):
    truth = truth_of(OBJECTS, tmp_path)
    empty = replace(cube(), faces=np.zeros((0, 3), np.int32))
    assert match_by_shape({}, truth, 0) == match_by_shape({5: empty}, truth, 0) == {}
    assert match_by_shape({5: cube(at=(50.0, 0, 0)), 6: OBJECTS[2]}, truth, 0) == {2: 6}
    assert match_by_id({1: empty, 2: OBJECTS[1], 8: OBJECTS[3]}, truth) == {2: 2}
    assert truth.label(1) == "crate" and truth.label(2) == "object 2"


def test_every_metric_has_words_and_a_sensible_form():
    for name, form in METRICS.items():
        assert form.title and form.meaning and form.meaning[0].islower() and not form.meaning.endswith("."), name
        assert form.shown(None) == NOTHING
        assert float(form.shown(0.5).replace(",", "")) == pytest.approx(0.5 * form.scale, abs=10.0**-form.digits)
    assert METRICS["accuracy"].shown(0.00512) == "5.1" and METRICS["accuracy"].less_is_better
    assert METRICS["iou"].shown(0.98765) == "0.988" and not METRICS["iou"].less_is_better
    assert METRICS["penetration_volume"].shown(1.2345) == "1,234.50"
    assert len({form.title for form in METRICS.values()}) == len(METRICS)
