import numpy as np
import pytest
import torch

from goc.complete import LiteConfig, build
from goc.files import write_json, write_tensors
from goc.training.evaluate import EvalConfig, evaluate, table
from goc.training.held_out import (
    case_of,
    guess_convex,
    guess_hull,
    guess_network,
    guess_nothing,
    score,
    show,
)
from goc.training.library import STEPS, Kept, Manifest
from goc.training.masking import MaskConfig, mask
from goc.training.primitives import Ellipsoid
from goc.training.solids import Part, paint

BALL = paint([Part(body=Ellipsoid((1.0, 0.8, 0.9)), at=(0, 0, 0))], 40)
NETWORK = build(LiteConfig(cells=16, fine=8, middle=16, width=24, blocks=1, heads=2, hidden=16)).eval()


@pytest.fixture(scope="module")
def case():
    looked = mask(BALL, MaskConfig(arc=1.0, room=0.0, noise=0.0, without_space=0.0), np.random.default_rng(0))
    return case_of(looked, 32)


def test_the_truth_scores_best(case):
    best = score(case, case.truth)
    assert best.iou == 1.0 and best.decided_right == 1.0
    assert best.f_score > 0.99 and best.chamfer_mean < 0.012
    assert best.chamfer_sum == pytest.approx(2 * best.chamfer_mean)


def test_the_convex_hull_of_a_ball_is_better_than_nothing(case):
    nothing, convex = (score(case, case.composed(guess(case))) for guess in (guess_nothing, guess_convex))
    assert convex.iou > nothing.iou
    assert convex.f_score > nothing.f_score


def test_composition_keeps_what_was_seen_and_fills_the_rest(case):
    field = case.composed(np.full_like(case.truth, -0.02))
    assert (field[case.channels[2] >= 0.5][case.channels[1][case.channels[2] >= 0.5] < 0.3] > 0).all()
    assert (field[~case.decided] == np.float32(-0.02)).all()
    hull = case.composed(guess_hull(case))
    assert (hull < 0).sum() > (case.composed(guess_nothing(case)) < 0).sum()


def test_a_network_s_guess_has_the_sign_of_its_logits(case):
    guess = guess_network(case, NETWORK, 0.5)
    assert guess.shape == case.truth.shape
    strict = guess_network(case, NETWORK, 0.9)
    assert (strict >= guess).all()


def test_an_empty_guess_scores_nothing(case):
    found = score(case, np.full_like(case.truth, 1.0))
    assert found.iou == 0 and found.f_score == 0


def test_pictures_show_seen_guessed_and_true(case):
    pictures = show(case, [case.truth], size=24)
    assert [picture.shape for picture in pictures] == [(24, 24, 3)] * 3
    assert (pictures[2] < 200).any()


def test_evaluation_puts_the_network_beside_what_needs_no_training(tmp_path):
    steps = np.clip(np.rint(BALL.distance * (STEPS / BALL.voxel)), -127, 127).astype(np.int8)
    write_tensors(tmp_path / "shapes-0000.safetensors", {"ball/distance": torch.from_numpy(steps)})
    kept = Kept(
        name="ball",
        split="val",
        shard="shapes-0000.safetensors",
        how="closed",
        origin=tuple(float(v) for v in BALL.origin),
        voxel=BALL.voxel,
    )
    write_json(tmp_path / "manifest.json", Manifest(kept=[kept]))
    rows = evaluate(tmp_path, NETWORK, EvalConfig(cells=24))
    methods = {row.method for row in rows}
    assert methods == {"nothing", "evidence hull", "convex hull", "network alone", "network"}
    assert {row.group for row in rows} == {"1-3 views", "4-6 views", "room", "all"}
    assert table(rows).count("\n") == len(rows) + 2
