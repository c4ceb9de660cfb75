"""Monocular depth aligned before there are splats, on a tiny room of boxes; and the stage that does it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import captures
from goc.capture import CaptureConfig, load_capture
from goc.events import ignore
from goc.priors import PriorsConfig, StereoConfig, add_priors
from goc.priors.monocular import align_views
from goc.reconstruct.monocular import aligned_capture
from goc.scene import Capture, PointCloud
from monocular import LINES, known, line, truth, written


@pytest.fixture(scope="module")
def affine(tmp_path_factory) -> Capture:
    return written(tmp_path_factory.mktemp("affine"), "affine")


@pytest.mark.parametrize("kind", ["affine", "inverse"])
def test_known_depths_give_each_view_its_scale_and_offset(tmp_path, kind):
    capture = written(tmp_path, kind)
    rows = align_views(capture, list(range(8)), known(capture), print)
    seen = aligned_capture(capture, rows)
    assert seen.has_metric_depth and not capture.has_metric_depth
    for view in range(8):
        k, b = line(view, kind)
        assert rows[view, :2].tolist() == pytest.approx([k, b], abs=0.02)  # stored to a tenth of a millimetre
        error = (seen[view].depth - truth(view)).abs() / truth(view)
        assert error[torch.isfinite(error)].median() < 0.01
        assert torch.isfinite(error).float().mean() > 0.6


def test_sparse_points_align_too_and_hidden_ones_do_not_disturb(affine):
    """A tenth of the surface of every view as points: each view sees through its walls those of all others."""
    points = []
    for pose in captures.poses(8):
        shot = captures.see(pose)
        u, v = np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
        rays = np.stack([(u - 31.0) / 50.0, (v - 24.5) / 51.0, np.ones_like(u)], -1) @ pose[:3, :3].T
        points.append((pose[:3, 3] + rays * shot.depth[..., None]).reshape(-1, 3)[::10])
    positions = np.concatenate(points).astype(np.float32)
    cloud = PointCloud(positions=positions, colours=np.zeros((len(positions), 3), np.uint8))
    rows = align_views(replace(affine, points=cloud), list(range(8)), {}, print)
    errors = [abs(rows[view, 0].item() / LINES[view][0] - 1.0) for view in range(8)]
    assert max(errors) < 0.05 and np.median(errors) < 0.01


def test_a_view_that_nothing_is_known_of_has_no_depth(affine):
    heard = []
    bare = replace(affine, points=None)
    rows = align_views(bare, list(range(8)), known(affine, [0, 2]), heard.append)
    assert torch.isfinite(rows[:, 0]).tolist() == [True, False, True, *[False] * 5]
    assert heard[-1].message == "the depth of 6 of 8 views (first: images/0001.png) agrees with nothing known"
    seen = aligned_capture(bare, rows)
    assert seen[0].depth is not None and seen[1].depth is None
    assert not aligned_capture(bare, align_views(bare, list(range(8)), {}, heard.append)).has_depth


def test_the_stage_adds_what_a_capture_lacks(affine, tmp_path):
    """Metric depth needs nothing; photographs get stereo; monocular depth is aligned, with points if there are many."""
    small = PriorsConfig(stereo=StereoConfig(side_px=48, neighbours=4, planes=32))
    folder = captures.write_nerfstudio(tmp_path, views=8)
    measured, photographs = load_capture(folder), load_capture(folder, CaptureConfig(use_depth=False))
    assert add_priors(measured, small) is measured
    alone = replace(photographs, cameras=photographs.cameras[:1], view_names=photographs.view_names[:1])
    assert add_priors(alone, small) is alone
    found = add_priors(photographs, small, views=[0, 1, 2, 3, 5]).priors
    assert found.alignment is None and set(found.stereo) == {0, 1, 2, 3, 5}
    both = add_priors(affine, small).priors
    assert len(both.stereo) == 8 and both.alignment.shape[0] == 8
    enough = add_priors(affine, replace(small, fewest_points=0, bend=False), views=[1, 2]).priors
    assert enough.stereo is None
    assert torch.isnan(enough.alignment[[0, *range(3, 8)]]).all()
    assert torch.equal(enough.alignment.nan_to_num(), align_views(affine, [1, 2], {}, ignore).nan_to_num())
