"""Monocular depth on a tiny room of boxes: aligned before the start, again while optimising, and view by view."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

import captures
from goc.capture import CaptureConfig, load_capture
from goc.files import write_depth
from goc.reconstruct import Mcmc, Monocular, ReconstructConfig, reconstruct
from goc.reconstruct.geometry_prior import geometry_priors
from goc.reconstruct.losses import RenderedDepth
from goc.reconstruct.monocular import ROW, aligned_capture, aligned_frame, refresh, start_alignment
from goc.scene import Capture, PointCloud

QUICK = ReconstructConfig(iterations=60, checkpoint_every=0, mcmc=Mcmc(max_splats=1500, every=10))
LINES = [(k, b) for k, b in zip(np.geomspace(0.5, 2.0, 8), np.linspace(-0.1, 0.5, 8), strict=True)]
"""k and b of each view."""


def written(folder, kind: str, change=captures.keep) -> Capture:
    """The box room with depth stored up to k and b of each view: D = (z - b) / k, or (1/z - b) / k."""

    def all_changes(document):
        document |= {"depth_kind": kind, "depth_unit_scale_factor": 0.0001}
        change(document)

    captures.write_nerfstudio(folder, views=8, change=all_changes)
    for view, pose in enumerate(captures.poses(8)):
        depth = captures.see(pose).depth
        k, b = line(view, kind)
        stored = ((depth if kind == "affine" else 1.0 / depth) - b) / k
        write_depth(folder / f"depth/{view:04d}.png", 10.0 * stored)
    return load_capture(folder, CaptureConfig(units_per_metre=1.0))


def line(view: int, kind: str) -> tuple[float, float]:
    k, b = LINES[view]
    return (k, b) if kind == "affine" else (k, -0.3 * b - 0.05)


def truth(view: int) -> torch.Tensor:
    return torch.from_numpy(captures.see(captures.poses(8)[view]).depth).float()


def known(capture: Capture, views=range(8), side: int = 16) -> dict:
    """What stereo would say: true depth of every fourth pixel, a fifth of it wrong."""
    found = {}
    for view in views:
        depth = truth(view)[2::4, 2::4].clone()
        wrong = torch.rand(depth.shape, generator=torch.Generator().manual_seed(view)) < 0.2
        depth[wrong] = 0.7
        found[view] = capture.cameras[view].resized(16, 12), depth
    return found


def shown(depth: torch.Tensor, alpha: float = 1.0) -> RenderedDepth:
    depth = depth[None]
    opaque = torch.full_like(depth, alpha)
    return RenderedDepth(numerator=depth * opaque, denominator=opaque, alpha=opaque)


def row_of(k: float, b: float) -> torch.Tensor:
    return torch.cat([torch.tensor([k, b, 0.0, b / k]), torch.zeros(ROW - 4)])


@pytest.fixture(scope="module")
def affine(tmp_path_factory) -> Capture:
    return written(tmp_path_factory.mktemp("affine"), "affine")


@pytest.mark.parametrize("kind", ["affine", "inverse"])
def test_known_depths_give_each_view_its_scale_and_offset(tmp_path, kind):
    capture = written(tmp_path, kind)
    rows = start_alignment(capture, list(range(8)), known(capture), print)
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
    rows = start_alignment(replace(affine, points=cloud), list(range(8)), {}, print)
    errors = [abs(rows[view, 0].item() / LINES[view][0] - 1.0) for view in range(8)]
    assert max(errors) < 0.05 and np.median(errors) < 0.01


def test_a_view_that_nothing_is_known_of_has_no_depth(affine):
    heard = []
    bare = replace(affine, points=None)
    rows = start_alignment(bare, list(range(8)), known(affine, [0, 2]), heard.append)
    assert torch.isfinite(rows[:, 0]).tolist() == [True, False, True, *[False] * 5]
    assert heard[-1].message == "the depth of 6 of 8 views (first: images/0001.png) agrees with nothing known"
    seen = aligned_capture(bare, rows)
    assert seen[0].depth is not None and seen[1].depth is None
    assert not aligned_capture(bare, start_alignment(bare, list(range(8)), {}, heard.append)).has_depth


def test_ramps_of_blurred_edges_are_left_out(affine):
    """A step from 1 m to 3 m, smeared over five pixels; the slanted floor stays."""
    frame = affine[0]
    depth = (1.0 + (torch.arange(64) - 30).clamp(0, 5) / 2.5).expand(48, 64)
    row = row_of(1.0, 0.0)
    found = aligned_frame(replace(frame, depth=depth), row, "affine").depth
    assert torch.isnan(found[:, 30:35]).all() and torch.isfinite(found[:, :28]).all()
    assert torch.isfinite(found[:, 38:]).all()
    rays = torch.arange(48) / 51.0 + 0.2
    floor = (1.5 / rays)[:, None].expand(48, 64).clamp(max=4.0)  # 70 degrees from head-on at 4 m
    assert torch.isfinite(aligned_frame(replace(frame, depth=floor), row, "affine").depth).float().mean() > 0.95


def test_a_refresh_follows_the_rendered_depth_when_it_is_due(affine):
    config = Monocular(refresh_every=2, smoothing=0.5)
    k, b = LINES[3]
    row = row_of(k * 1.2, b)
    before = row.clone()
    refresh(row, affine[3], "affine", shown(truth(3)), 1, config)
    assert torch.equal(row, before)
    refresh(row, affine[3], "affine", shown(truth(3)), 2, config)
    assert row[:3].tolist() == pytest.approx([k * 1.1, b, 2.0], abs=0.01)
    unknown = torch.full((ROW,), torch.nan)
    refresh(unknown, affine[3], "affine", shown(truth(3)), 0, config)
    assert unknown[:4].tolist() == pytest.approx([k, b, 0.0, b / k], abs=0.01)


@pytest.mark.parametrize("rendered", [shown(torch.full((48, 64), 2.0)), shown(torch.ones(48, 64), alpha=0.1)])
def test_a_refresh_without_an_answer_leaves_the_old_one(affine, rendered):
    row = row_of(1.0, 0.1)
    before = row.clone()
    refresh(row, affine[0], "affine", rendered, 5, Monocular(refresh_every=1))
    assert torch.equal(row, before)
    refresh(row, affine[0], "affine", shown(truth(0)), 5, Monocular(refresh_every=0))
    assert torch.equal(row, before)


def test_normals_follow_the_shape_not_the_scale(affine):
    priors = geometry_priors(affine, True, Monocular(refresh_every=1, smoothing=0.0))
    views = {"alignment": torch.full((8, ROW), torch.nan)}
    first = priors(0, views, shown(truth(0)), 0)
    row = views["alignment"][0].clone()
    doubled = priors(0, views, shown(2.0 * truth(0)), 1)
    torch.testing.assert_close(doubled.depth, 2.0 * first.depth, equal_nan=True, rtol=1e-3, atol=1e-3)
    assert torch.equal(torch.nan_to_num(doubled.normals), torch.nan_to_num(first.normals))
    assert views["alignment"][0, 3] == row[3]
    deeper = priors(0, views, shown(truth(0) + 1.0), 2)
    assert not torch.equal(torch.nan_to_num(deeper.normals), torch.nan_to_num(first.normals))


def test_given_normals_count_without_depth(affine):
    normals = torch.zeros(48, 64, 3)
    normals[..., 2] = -1.0
    bare = replace(affine, frames=lambda index: replace(affine[index], depth=None, normals=normals))
    views = {"alignment": torch.full((8, ROW), torch.nan)}
    for kind in ("affine", "metric"):
        found = geometry_priors(replace(bare, depth_kind=kind), True, Monocular())(0, views, shown(truth(0)), 0)
        assert torch.isnan(found.depth).all() and torch.equal(found.normals, normals[None])
        assert geometry_priors(replace(bare, depth_kind=kind), False, Monocular())(0, views, shown(truth(0)), 0) is None


def test_a_monocular_capture_is_reconstructed_like_one_of_a_depth_camera(affine):
    found = reconstruct(affine, replace(QUICK, iterations=150), known_depths=lambda: known(affine))
    assert "train_median_depth_error_m" not in found.metrics  # nothing here was measured in metres
    from goc.raster import render

    errors = [(render(found.gaussians, affine.cameras[view]).plane_depth - truth(view)).abs() for view in range(8)]
    assert torch.cat([error[torch.isfinite(error)] for error in errors]).median() < 0.02


def test_without_any_anchor_it_starts_from_the_points(affine):
    heard = []
    found = reconstruct(affine, replace(QUICK, iterations=20), heard.append, known_depths=dict)
    assert any("agrees with nothing known" in getattr(event, "message", "") for event in heard)
    assert torch.isfinite(found.gaussians.means).all()


@pytest.mark.parametrize("every", [0, 1])
def test_a_stopped_run_resumes_bit_equal(affine, tmp_path, every):
    config = replace(QUICK, iterations=40, checkpoint_every=20, monocular=Monocular(refresh_every=every))
    whole = reconstruct(affine, config, known_depths=lambda: known(affine))

    class Stopped(Exception):
        pass

    def stop(event):
        if event.stage == "reconstruct" and getattr(event, "done", 0) == 27:
            raise Stopped

    path = tmp_path / "checkpoint.safetensors"
    with pytest.raises(Stopped):
        reconstruct(affine, config, stop, path, known_depths=lambda: known(affine))
    resumed = reconstruct(affine, config, checkpoint=path, resume=True)
    for item in fields(whole.gaussians):
        a, b = getattr(whole.gaussians, item.name), getattr(resumed.gaussians, item.name)
        assert a is b is None or torch.equal(a, b)
