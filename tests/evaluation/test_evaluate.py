"""Whole evaluations of small rooms whose answers are known."""

import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from assets import box_scene
from captures import ROOM_BOX
from goc.capture import load_capture
from goc.errors import CaptureError, EvaluationError, FileError
from goc.evaluation import Evaluation, evaluate, write_evaluation
from goc.evaluation.prediction import read_prediction
from goc.evaluation.protocols.replica import oriented_box
from goc.evaluation.truth import read_truth
from goc.events import Warned, ignore
from goc.files import write_mesh
from goc.pipeline import CarveConfig
from goc.report import write_report
from goc.runs import RunRecord
from solids import cuboid, joined, moved, sphere, with_face_flipped
from truths import CRATE, CUPBOARD, ROOM, write_run, write_truth

WHOLE = joined(ROOM, CRATE, CUPBOARD)


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    return write_truth(tmp_path_factory.mktemp("room"))


@pytest.fixture
def perfect(tmp_path):
    return write_run(tmp_path / "run", {1: CRATE, 2: CUPBOARD}, WHOLE)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda mesh: replace(mesh, vertices=mesh.vertices * np.float32(1000)), "in millimetres. Scale it to metres"),
        (lambda mesh: replace(mesh, vertices=mesh.vertices * np.float32(3.28)), "it seems to be in feet"),
        (
            lambda mesh: replace(mesh, vertices=mesh.vertices / np.float32(5)),
            "times as large as the truth, and its scores",
        ),
        (lambda mesh: moved(mesh, (90.0, 0.0, 0.0)), "lies beside the truth, not in it"),
        (lambda mesh: mesh, None),
    ],
)
def test_a_run_in_another_unit_or_frame_is_told(truth, tmp_path, change, words):
    run = write_run(tmp_path / "run", {1: change(CRATE), 2: change(CUPBOARD)}, change(WHOLE))
    heard = []
    evaluate(run, truth, notify=heard.append)
    warnings = [event.message for event in heard if isinstance(event, Warned)]
    assert len(warnings) == (words is not None) and all(words in message for message in warnings)


@pytest.fixture
def few_samples(monkeypatch):
    monkeypatch.setattr("goc.evaluation.protocols.phyrecon._NORMAL_SAMPLES", 20_000)
    monkeypatch.setattr("goc.evaluation.protocols.replica._SCENE_SAMPLES", 80_000)


def test_the_truth_itself_is_perfect(truth, perfect):
    found = evaluate(perfect, truth)
    assert found.protocol == "goc" and found.matching == "ids" and found.missing == [] and found.extra == []
    assert (found.counts.objects, found.counts.found, found.counts.watertight) == (2, 2, 2)
    assert found.objects[1].label == "crate" and found.objects[1].mesh == "observed" and found.objects[1].flaw is None
    for name in ("f_score_0.05", "iou", "watertight", "label_accuracy", "label_recall"):
        assert found.mean[name] == pytest.approx(1.0, abs=1e-3), name
    assert found.mean["accuracy"] < 0.02 and found.mean["normal_consistency"] > 0.97  # 4,000 true samples: sparse
    assert found.mean["volume_relative_error"] == pytest.approx(0.0, abs=1e-6)
    assert found.mean["self_intersections"] == found.mean["penetration_depth"] == found.mean["room_volume"] == 0.0
    assert found.deepest["penetration_depth"] == found.deepest["bottom_error"] == 0.0
    assert found.objects[1].figures["volume_ratio"] == pytest.approx(1.0, abs=1e-6)
    assert found.objects[1].figures["volume"] == pytest.approx(0.9 * 0.8 * 0.7, rel=1e-5)
    assert found.scene is not None and found.scene["recall_0.05"] > 0.99
    assert set(found.mean_over.values()) == {2}


def test_bottoms_are_told_with_their_sign_and_the_deepest_is_named(truth, tmp_path):
    sunk, raised = moved(CRATE, (0, 0, -0.02)), moved(CUPBOARD, (0, 0, 0.005))
    found = evaluate(write_run(tmp_path / "run", {1: sunk, 2: raised}), truth)
    assert [found.objects[id].figures["bottom"] for id in (1, 2)] == pytest.approx([-0.02, 0.005], abs=1e-6)
    assert found.mean["bottom_error"] == pytest.approx(0.0125, abs=1e-6) and "bottom" not in found.mean
    assert [found.deepest[name] for name in ("bottom_error", "room_depth")] == pytest.approx([0.02, 0.02], abs=1e-6)


def test_a_missing_object_counts_and_is_named(truth, tmp_path):
    found = evaluate(write_run(tmp_path, {1: CRATE}), truth)
    assert found.missing == [2] and found.counts.missing == 1 and found.scene is None
    assert found.objects[2].predicted is None and found.objects[2].watertight is None
    for name in ("f_score_0.05", "f_score_0.01", "iou", "watertight", "label_accuracy", "label_recall"):
        assert found.objects[2].figures[name] == 0.0, name
        assert found.mean[name] == pytest.approx(found.objects[1].figures[name] / 2), name
    assert found.objects[2].figures["completion"] is None
    assert found.mean["chamfer"] == found.objects[1].figures["chamfer"] and found.mean_over["chamfer"] == 1


def test_an_empty_run_misses_everything(truth, tmp_path):
    found = evaluate(write_run(tmp_path, {}), truth)
    assert found.missing == [1, 2] and found.mean["f_score_0.05"] == 0.0 and found.mean["accuracy"] is None
    assert evaluate(write_run(tmp_path, {}), truth, matching="shape").missing == [1, 2]


def test_extra_objects_are_listed_with_what_they_lie_on(truth, tmp_path):
    extra = cuboid((0.2, 0.2, 0.0), (0.4, 0.4, 0.01))
    found = evaluate(write_run(tmp_path, {1: CRATE, 2: CUPBOARD, 7: extra}), truth)
    assert [item.predicted for item in found.extra] == [7] and found.extra[0].nearest_truth == 0
    assert found.extra[0].area_m2 == pytest.approx(2 * 0.04 + 4 * 0.2 * 0.01, rel=1e-5)
    assert found.mean["f_score_0.05"] == pytest.approx(1.0, abs=1e-3)


def test_an_extra_object_that_took_the_surface_costs_label_recall(truth, tmp_path):
    found = evaluate(write_run(tmp_path, {1: moved(CRATE, (0, 0, 0.015)), 2: CUPBOARD, 7: CRATE}), truth)
    lid, sides = 0.9 * 0.8, 0.7 * 2 * (0.9 + 0.8)  # the sides are both's, the lid is 7's; nobody saw the bottom
    assert found.objects[1].figures["label_recall"] == pytest.approx(sides / (lid + sides), abs=0.02)
    assert found.objects[2].figures["label_recall"] == 1.0


def test_ids_of_their_own_are_matched_by_shape(truth, tmp_path):
    run = write_run(tmp_path, {31: CUPBOARD, 4: CRATE, 9: moved(CRATE, (0.0, 0.0, 1.5))})
    assert evaluate(run, truth).missing == [1, 2]
    (run / "report.json").write_text(json.dumps({"goc": "0.1", "capture": {"has_ids": False, "path": "x"}}))
    with pytest.raises(FileError, match=r"report\.json: has schema 0 of an older goc.*Carve again"):
        evaluate(run, truth)
    blind = replace(load_capture(truth), has_ids=False)
    write_report(run / "report.json", truth, blind, box_scene(), RunRecord(ignore), CarveConfig())
    found = evaluate(run, truth)
    assert found.matching == "shape" and found.missing == []
    assert {id: item.predicted for id, item in found.objects.items()} == {1: 4, 2: 31}
    assert [item.predicted for item in found.extra] == [9]


def test_penetration_self_cuts_and_flaws_are_found(truth, tmp_path):
    low, high = CRATE.vertices.min(axis=0), CRATE.vertices.max(axis=0)
    pressed = cuboid(low - [0, 0, 0.03], high + [0.5, 0, 0])  # 0.1 into the cupboard, 0.03 into the floor
    found = evaluate(write_run(tmp_path, {1: pressed, 2: joined(CUPBOARD, sphere(0.2, (2.61, 1.72, 1.113)))}), truth)
    first, second = found.objects[1].figures, found.objects[2].figures
    assert first["penetration_depth"] == second["penetration_depth"] == pytest.approx(0.1, abs=5e-3)
    assert first["penetration_volume"] == pytest.approx(0.1 * 0.3 * 0.7, rel=0.02)
    assert first["room_depth"] == pytest.approx(0.03, abs=1e-6) and second["room_depth"] == 0.0
    assert first["self_intersections"] == 0 and second["self_intersections"] > 10
    flipped = evaluate(write_run(tmp_path, {1: with_face_flipped(CRATE)}), truth).objects[1]
    assert flipped.watertight is False and flipped.flaw == "3 edges are run along twice in the same direction"
    assert flipped.figures["iou"] == 0.0 and flipped.figures["volume"] is None


def test_which_mesh_is_judged(truth, tmp_path):
    run = write_run(tmp_path, {1: moved(CRATE, (0.2, 0, 0)), 2: CUPBOARD})
    write_run(tmp_path, {1: CRATE}, name="mesh")
    best, observed, completed = (evaluate(run, truth, meshes=choice) for choice in ("best", "observed", "completed"))
    assert (best.objects[1].mesh, best.objects[2].mesh) == ("completed", "observed")
    assert best.objects[1].figures["iou"] == 1.0 and observed.objects[1].figures["iou"] < 0.9
    assert completed.missing == [2]


def test_a_folder_of_meshes_will_do(truth, tmp_path):
    write_mesh(tmp_path / "1.ply", CRATE)
    write_mesh(tmp_path / "scene.ply", WHOLE)
    (tmp_path / "notes.ply").write_text("not looked at")
    found = evaluate(tmp_path, truth)
    assert found.objects[1].mesh == "file" and found.missing == [2] and found.scene is not None


def test_an_evaluation_can_be_written_and_read_again_and_repeats_itself(truth, perfect, tmp_path, monkeypatch):
    monkeypatch.setattr("goc.evaluation.error_maps._SIZE", 24)
    found = evaluate(perfect, truth)
    write_evaluation(found, tmp_path / "a", worst=1)
    write_evaluation(evaluate(perfect, truth), tmp_path / "b", worst=1)
    for name in ("eval.json", "eval.html"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert msgspec.json.decode((tmp_path / "a/eval.json").read_bytes(), type=Evaluation) == found
    assert evaluate(perfect, truth, seed=1).mean != found.mean


def test_what_cannot_be_judged_is_refused(truth, tmp_path):
    with pytest.raises(EvaluationError, match=r"absent: not found. Give the output folder"):
        evaluate(tmp_path / "absent", truth)
    with pytest.raises(EvaluationError, match=r"holds no objects/<id>/observed.ply and no <id>.ply"):
        read_prediction(tmp_path, "best")
    write_mesh(tmp_path / "1.ply", CRATE)
    with pytest.raises(FileError, match=r"points.npz: cannot be read"):
        evaluate(tmp_path, tmp_path)
    bare = write_truth(tmp_path / "bare")
    (bare / "transforms.json").unlink()
    with pytest.raises(CaptureError, match="no capture here"):
        evaluate(tmp_path, bare, "phyrecon-scannet")
    (bare / "gt/objects/2.ply").unlink()
    with pytest.raises(FileError, match=r"objects/2.ply"):
        evaluate(tmp_path, bare)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"p1": np.zeros((4, 2), np.float32)}, r"array p1 is \(4, 2\) float32, expected rows of 3"),
        ({"n2": np.full((4000, 3), np.nan, np.float32)}, "array n2 holds numbers that are not finite"),
        ({"pillow": np.zeros((4, 3), np.float32)}, "array 'pillow' is none of"),
        ({"seen": np.zeros((0, 7), np.float32)}, "array seen is"),
    ],
)
def test_malformed_truth_is_refused(tmp_path, change, text):
    path = write_truth(tmp_path) / "gt/points.npz"
    with np.load(path) as arrays:
        kept = dict(arrays)
    np.savez(path, **(kept | change | ({"nillow": np.zeros((4, 3))} if "pillow" in change else {})))
    with pytest.raises(FileError, match=text):
        read_truth(tmp_path)


@pytest.mark.parametrize("protocol", ["phyrecon-scannet", "objectsdf-replica"])
def test_published_protocols_find_the_truth_perfect_and_a_shift_not(truth, perfect, tmp_path, protocol, few_samples):
    found = evaluate(perfect, truth, protocol)
    assert found.counts.skipped == 0 and found.settings["views"] == 6
    assert found.mean["f_score_0.05"] > 0.995 and found.mean["normal_consistency"] > 0.97
    assert found.mean["chamfer"] < 0.012 and found.scene["f_score_0.05"] > 0.97
    shifted = evaluate(write_run(tmp_path / "off", {1: moved(CRATE, (0, 0, 0.03)), 2: CUPBOARD}), truth, protocol)
    assert shifted.scene is None
    assert 0.004 < shifted.objects[1].figures["accuracy"] < 0.03
    assert shifted.objects[1].figures["chamfer"] > found.objects[1].figures["chamfer"]


def test_phyrecon_skips_failures_and_says_so(truth, tmp_path, few_samples):
    found = evaluate(write_run(tmp_path, {1: CRATE, 2: moved(CUPBOARD, (-1.9, 0.1, 0.3))}), truth, "phyrecon-scannet")
    assert found.objects[2].skipped == "F is 0" and found.counts.skipped == 1 and found.missing == []
    assert found.mean["f_score_0.05"] == found.objects[1].figures["f_score_0.05"] > 0.99
    gone = evaluate(write_run(tmp_path / "less", {1: CRATE}), truth, "phyrecon-scannet")
    assert gone.objects[2].skipped == "missing" and gone.missing == [2] and gone.mean_over["f_score_0.05"] == 1
    kept = evaluate(write_run(tmp_path / "less", {}), truth, "objectsdf-replica")
    assert kept.counts.skipped == 0 and kept.mean["f_score_0.05"] == kept.objects[1].figures["f_score_0.05"] / 2


def test_replica_cuts_what_lies_outside_the_true_box(truth, tmp_path):
    """A second crate far outside the first one's box is not held against the prediction."""
    both = joined(CRATE, moved(CRATE, (0.0, 0.0, 1.5)))
    found = evaluate(write_run(tmp_path, {1: both, 2: CUPBOARD}), truth, "objectsdf-replica")
    assert found.objects[1].figures["f_score_0.05"] > 0.99
    assert evaluate(tmp_path, truth).objects[1].figures["f_score_0.05"] < 0.8


def test_the_oriented_box_of_a_turned_box():
    angle = 0.6
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    corners = cuboid((-1, -0.5, -0.2), (1, 0.5, 0.2)).vertices.astype(np.float64) @ turn.T + [3, 4, 5]
    box = oriented_box(corners)
    np.testing.assert_allclose(np.sort(box.extents), [0.4, 1.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(box.centre, [3, 4, 5], atol=1e-6)
    assert box.holds(corners, 1.001).all() and not box.holds(corners, 0.999).any()
    flat = oriented_box(corners * [1, 1, 0])
    np.testing.assert_allclose(flat.extents[2], 0, atol=1e-12)


def test_the_room_box_is_as_the_tests_think():
    np.testing.assert_allclose(np.ptp(ROOM.vertices, axis=0), np.ptp(ROOM_BOX, axis=0))
