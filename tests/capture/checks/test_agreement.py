"""Views that agree through depth do so whatever the world; readings find their own cause."""

from dataclasses import replace

import numpy as np
import pytest

from goc.capture import CaptureConfig, load_capture
from goc.capture.checks.agreement import agreement
from goc.capture.checks.depth_views import depth_views
from goc.capture.checks.readings import scaled


@pytest.fixture(scope="module")
def views(sound):
    return depth_views(list(load_capture(sound, CaptureConfig(checks="off"))))


def test_a_right_capture_agrees(views):
    found = agreement(views)
    assert found.share > 0.95
    assert found.gap < 0.02
    assert found.compared > 1000


def test_agreement_does_not_depend_on_the_world(views):
    turn = np.eye(4)
    turn[:3, :3] = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn[:3, :3] *= np.sign(np.linalg.det(turn[:3, :3]))
    turn[:3, 3] = [3.0, -2.0, 5.0]
    assert agreement(replace(views, poses=turn @ views.poses)).share == pytest.approx(agreement(views).share, abs=1e-3)


def test_depth_of_another_unit_disagrees(views):
    for factor in (0.001, 0.5, 1.5, 1000.0):
        assert agreement(scaled(views, factor)).share < 0.8


def test_views_that_share_nothing_compare_nothing(views):
    away = views.poses.copy()
    away[:, 0, 3] += 1000.0 * np.arange(len(away))
    found = agreement(replace(views, poses=away))
    assert (found.share, found.compared) == (0.0, 0)
