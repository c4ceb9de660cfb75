import math

import pytest
import torch

from goc.training.losses import T_ISO, LossConfig, completion_loss, hard_iou, iou_loss, occupancy_loss, smooth_occupancy


def logit(p):
    return math.log(p / (1 - p))


@pytest.mark.parametrize(
    ("distance", "label"), [(-1.0, 1.0), (-T_ISO, 1.0), (-T_ISO / 2, 0.75), (0.0, 0.5), (T_ISO / 2, 0.25), (T_ISO, 0.0)]
)
def test_labels_are_linear_within_the_band(distance, label):
    assert smooth_occupancy(torch.tensor(distance)).item() == pytest.approx(label, abs=1e-6)


def test_cross_entropy_of_a_known_guess():
    logits = torch.full((1, 2), logit(0.8))
    found = occupancy_loss(logits, torch.tensor([[-1.0, 1.0]]))
    assert found.item() == pytest.approx(-(math.log(0.8) + math.log(0.2)) / 2, rel=1e-5)


def test_hard_and_sure_states_give_the_plain_iou():
    logits = torch.tensor([[9.0, 9.0, -9.0, -9.0]])
    distance = torch.tensor([[-1.0, 1.0, -1.0, 1.0]])
    assert iou_loss(logits, distance, LossConfig()).item() == pytest.approx(2 / 3, abs=5e-3)
    assert hard_iou(logits, distance, 0.3).item() == pytest.approx(1 / 3)


def test_the_soft_iou_has_a_gradient_at_the_threshold_and_the_printed_one_would_not():
    logits = torch.full((1, 4), logit(0.3), requires_grad=True)
    iou_loss(logits, torch.tensor([[-1.0, -1.0, 1.0, 1.0]]), LossConfig()).backward()
    assert (logits.grad[0, :2] < 0).all() and (logits.grad[0, 2:] > 0).all()


def test_straight_through_has_hard_value_and_soft_gradient():
    config = LossConfig(iou_state="straight-through")
    logits = torch.tensor([[logit(0.35), logit(0.25)]], requires_grad=True)
    distance = torch.tensor([[-1.0, -1.0]])
    loss = iou_loss(logits, distance, config)
    assert loss.item() == pytest.approx(0.5)  # one of two inside points is above 0.3
    loss.backward()
    assert (logits.grad < 0).all()


def test_the_total_has_the_weights_of_the_paper():
    logits, distance = torch.randn(2, 50), torch.randn(2, 50)
    terms = completion_loss(logits, torch.tensor(7.0), distance, LossConfig())
    expected = terms["bce"] + 0.01 * terms["iou"] + 1e-4 * 7.0
    assert terms["loss"].item() == pytest.approx(expected.item(), rel=1e-6)
