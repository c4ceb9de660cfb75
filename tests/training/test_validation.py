import numpy as np
import pytest

from goc.complete import LiteConfig, build
from goc.training.cuts import AS_SEEN
from goc.training.masking import MaskConfig, mask
from goc.training.primitives import Ellipsoid
from goc.training.validation import case_of, guess_network, guess_nothing, preview, score
from goc.training.watertight_shape import CsgPart, shape_from_parts

BALL = shape_from_parts([CsgPart(body=Ellipsoid((1.0, 0.8, 0.9)), at=(0, 0, 0))], 40)
NETWORK = build(LiteConfig(cells=16, fine=8, middle=16, width=24, blocks=1, heads=2, hidden=16)).eval()


@pytest.fixture(scope="module")
def case():
    looked = mask(
        BALL,
        MaskConfig(arc=1.0, room=0.0, front=0.0, cuts=AS_SEEN, noise=0.0),
        np.random.default_rng(0),
    )
    return case_of(looked, 32)


def test_the_truth_scores_best(case):
    best = score(case, case.truth)
    assert best.iou == 1.0 and best.unknown_accuracy == 1.0


def test_composition_keeps_what_was_seen_and_fills_the_rest(case):
    field = case.composed(np.full_like(case.truth, -0.02))
    assert (field[case.channels[2] >= 0.5][case.channels[1][case.channels[2] >= 0.5] < 0.3] > 0).all()
    assert (field[~case.decided] == np.float32(-0.02)).all()
    assert score(case, field).iou != score(case, case.composed(guess_nothing(case))).iou


def test_a_network_s_guess_has_the_sign_of_its_logits(case):
    guess = guess_network(case, NETWORK, 0.5)
    assert guess.shape == case.truth.shape
    strict = guess_network(case, NETWORK, 0.9)
    assert (strict >= guess).all()


def test_an_empty_guess_scores_nothing(case):
    found = score(case, np.full_like(case.truth, 1.0))
    assert found.iou == 0
    assert found.unknown_accuracy < 1


def test_pictures_show_seen_guessed_and_true(case):
    pictures = preview(case, [case.truth], size=24)
    assert [picture.shape for picture in pictures] == [(24, 24, 3)] * 3
    assert (pictures[2] < 200).any()
