"""Scores of completions: laws that hold whatever the shape, and the table that a person reads."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
import torch

from goc.cli import main
from goc.complete import LiteConfig, OscConfig, build
from goc.complete.candidates import ALL
from goc.files import read_image, write_json, write_tensors
from goc.geometry.topology import signed_volume, watertight_flaw
from goc.scene import EvidenceGrid
from goc.training import evaluate as evaluating
from goc.training.baselines import completions, measured_object
from goc.training.cuts import AS_SEEN
from goc.training.evaluate import GROUPS, EvalConfig, evaluate, means, score, table
from goc.training.library import STEPS, Manifest, PreparedShape
from goc.training.masking import MaskConfig, mask
from goc.training.primitives import Ellipsoid
from goc.training.watertight_shape import CsgPart, shape_from_parts

BALL = shape_from_parts([CsgPart(body=Ellipsoid((1.0, 0.8, 0.9)), at=(0, 0, 0))], 40)
LITE = build(LiteConfig(cells=16, fine=8, middle=16, width=24, blocks=1, heads=2, hidden=16)).eval()
POINTS = build(OscConfig(encoder=1, decoder=1, width=16, heads=2, tokens=8, latent=4, points=32)).eval()
UNTRAINED = ["nothing", "screened Poisson", *(name for name in ALL if "network" not in name)]


def coarse(masked):
    """The same with a third of the voxels a side, for speed."""
    if masked is None:
        return None
    given = masked.partial.evidence
    part = (slice(None, None, 3),) * 3
    evidence = EvidenceGrid(
        origin=given.origin,
        voxel=3 * given.voxel,
        state=np.ascontiguousarray(given.state[part]),
        sdf=np.ascontiguousarray(given.sdf[part]),
    )
    return replace(masked, partial=replace(masked.partial, evidence=evidence))


@pytest.fixture(scope="module")
def half():
    """A ball in a few exact views from one side, and all that is made of it."""
    config = MaskConfig(
        arc=1.0,
        room=0.0,
        front=0.0,
        cuts=AS_SEEN,
        noise=0.0,
        jitter=0.0,
        size_px=48,
    )
    masked = coarse(mask(BALL, config, np.random.default_rng(3)))
    seen = measured_object(masked)
    return masked, seen, dict(completions(seen, masked, LITE, 0.5))


@pytest.fixture
def quick(monkeypatch):
    """Evaluations of coarse evidence with few samples."""
    monkeypatch.setattr(evaluating, "SAMPLES", 2000)
    monkeypatch.setattr(evaluating, "_SHARP_PX", 48)
    monkeypatch.setattr(evaluating, "mask", lambda *given: coarse(mask(*given)))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("prepared")
    steps = np.clip(np.rint(BALL.distance * (STEPS / BALL.voxel)), -127, 127).astype(np.int8)
    write_tensors(folder / "shapes-0000.safetensors", {"ball/distance": torch.from_numpy(steps)})
    kept = PreparedShape(
        name="ball",
        split="val",
        shard="shapes-0000.safetensors",
        how="closed",
        origin=tuple(float(v) for v in BALL.origin),
        voxel=BALL.voxel,
    )
    write_json(folder / "manifest.json", Manifest(kept=[kept]))
    return folder


def test_what_was_measured_is_open_and_lies_on_the_ball(half):
    masked, seen, _ = half
    assert "one side only" in watertight_flaw(seen.mesh)
    world = masked.cube.world_from_model(seen.mesh.vertices)
    assert np.abs(masked.placed.distances(world)).max() < 0.03


def test_every_completion_is_watertight_and_none_beats_the_truth(half):
    masked, _, made = half
    target = evaluating.object_truth(masked, 24)
    scores = {name: score(closed, target) for name, closed in made.items()}
    assert list(scores) == ["nothing", "screened Poisson", "network alone", *ALL, "choice", "perfect guess"]
    assert scores["nothing"].watertight == 0
    assert all(one.watertight == 1 for name, one in scores.items() if name not in ("nothing", "network alone"))
    best = scores.pop("perfect guess")
    assert best.iou > 0.75  # all of the ball but what lies beyond the box of the evidence
    assert all(best.iou >= one.iou and best.chamfer_mean <= one.chamfer_mean for one in scores.values())
    assert best.chamfer_sum == pytest.approx(2 * best.chamfer_mean) == pytest.approx(best.accuracy + best.completion)


def test_the_convex_hull_of_half_a_ball_is_more_than_what_was_seen(half):
    masked, _, made = half
    target = evaluating.object_truth(masked, 24)
    nothing, convex = (score(made[name], target) for name in ("nothing", "convex hull"))
    assert convex.iou > nothing.iou


def test_iou_counts_what_the_mesh_holds(half):
    """The share of the cube that is inside the field is the volume of the mesh."""
    masked, _, made = half
    target = evaluating.object_truth(masked, 48)
    for name in ("evidence hull", "perfect guess"):
        share = made[name].inside(target.centres).mean() * 8
        assert share == pytest.approx(signed_volume(made[name].mesh), rel=0.03)


def test_a_report_has_every_group_and_is_written_in_three_ways(data, quick, tmp_path, capsys):
    words = ["osc", "eval", str(data), "--baselines", "--cells", "24"]
    assert main([*words, "--json", str(tmp_path / "e.json"), "--pictures", str(tmp_path / "e.png")]) == 0
    shown = capsys.readouterr().out
    assert "1 shapes of split val" in shown and "24³ cells" in shown and "CD sum = Acc + Comp" in shown
    report = msgspec.json.decode((tmp_path / "e.json").read_bytes())
    groups = [*GROUPS, "all partial"]
    assert [(row["group"], row["method"]) for row in report["rows"]] == [
        (group, method) for group in groups for method in [*UNTRAINED, "perfect guess"]
    ]
    assert {row["count"] for row in report["rows"][:-7]} == {1} and report["rows"][-1]["count"] == 3
    assert len(report["outcomes"]) == 4 * 7
    complete = next(row for row in report["rows"] if row["group"] == "complete" and row["method"] == "evidence hull")
    assert complete["scores"]["iou"] > 0.95
    picture = read_image(tmp_path / "e.png")
    assert picture.shape == (22 + 4 * 176, 4 * 160, 3)
    assert (picture[40:180, :160] < 200).any() and (picture[40:180, 480:] < 200).any()


def test_networks_of_both_kinds_are_scored(data, quick):
    for network in (LITE, POINTS):
        report = evaluate(data, network, EvalConfig(cells=16, masks=1))
        assert "network" in {row.method for row in report.rows}
        assert table(report).count("\n| ") == len(report.rows)


def test_what_nothing_was_made_of_is_told_and_left_out_of_lengths(data, quick):
    (one, *_) = evaluate(data, None, EvalConfig(cells=16, masks=1)).outcomes
    lost = replace(one, score=replace(one.score, iou=0.0, accuracy=np.nan, completion=np.inf, chamfer_mean=np.inf))
    (row,) = means([one, lost])
    assert (row.count, row.empty) == (2, 1)
    assert row.scores["chamfer_mean"] == one.score.chamfer_mean
    assert row.scores["iou"] == pytest.approx(one.score.iou / 2)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--baselines", "--weights", "w.safetensors"], "Leave one of them out"),
        (["--baselines", "--pictures", "sheet.jpg"], "goc writes .png"),
    ],
)
def test_options_that_contradict_each_other_are_refused(data, capsys, words, text):
    assert main(["osc", "eval", str(data), *words]) == 2
    assert text in capsys.readouterr().err
