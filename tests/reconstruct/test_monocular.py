"""Monocular depth on a tiny room of boxes: seeds of aligned depth, and what is fitted again while optimising."""

from dataclasses import fields, replace

import pytest
import torch

from goc.events import ignore
from goc.geometry.monocular import ROW, aligned_frame
from goc.priors.monocular import align_views
from goc.reconstruct import Losses, Mcmc, Monocular, ReconstructConfig, reconstruct
from goc.reconstruct.geometry_prior import geometry_priors
from goc.reconstruct.losses import RenderedDepth
from goc.reconstruct.monocular import refresh
from goc.scene import Capture, CapturePriors
from monocular import LINES, known, truth, written

QUICK = ReconstructConfig(iterations=60, checkpoint_every=0, mcmc=Mcmc(max_splats=1500, every=10))


def aligned(capture: Capture) -> Capture:
    """The capture with priors: each view aligned with what is known of it."""
    rows = align_views(capture, list(range(8)), known(capture), ignore)
    return replace(capture, priors=CapturePriors(alignment=rows))


def shown(depth: torch.Tensor, alpha: float = 1.0) -> RenderedDepth:
    depth = depth[None]
    opaque = torch.full_like(depth, alpha)
    return RenderedDepth(numerator=depth * opaque, denominator=opaque, alpha=opaque)


def row_of(k: float, b: float) -> torch.Tensor:
    return torch.cat([torch.tensor([k, b, 0.0, b / k]), torch.zeros(ROW - 4)])


@pytest.fixture(scope="module")
def affine(tmp_path_factory) -> Capture:
    return written(tmp_path_factory.mktemp("affine"), "affine")


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
    found = reconstruct(aligned(affine), replace(QUICK, iterations=150))
    assert "train_median_depth_error_m" not in found.metrics  # nothing here was measured in metres
    from goc.raster import render

    errors = [(render(found.gaussians, affine.cameras[view]).plane_depth - truth(view)).abs() for view in range(8)]
    assert torch.cat([error[torch.isfinite(error)] for error in errors]).median() < 0.02


def test_without_any_anchor_it_starts_from_the_points(affine):
    found = reconstruct(affine, replace(QUICK, iterations=20))
    assert torch.isfinite(found.gaussians.means).all()


@pytest.mark.parametrize("every", [0, 1])
def test_a_stopped_run_resumes_bit_equal(affine, tmp_path, every):
    config = replace(QUICK, iterations=40, checkpoint_every=20, losses=Losses(monocular=Monocular(refresh_every=every)))
    whole = reconstruct(aligned(affine), config)

    class Stopped(Exception):
        pass

    def stop(event):
        if event.stage == "reconstruct" and getattr(event, "done", 0) == 27:
            raise Stopped

    path = tmp_path / "checkpoint.safetensors"
    with pytest.raises(Stopped):
        reconstruct(aligned(affine), config, stop, path)
    resumed = reconstruct(affine, config, checkpoint=path, resume=True)
    for item in fields(whole.gaussians):
        a, b = getattr(whole.gaussians, item.name), getattr(resumed.gaussians, item.name)
        assert a is b is None or torch.equal(a, b)
