"""`render_surface` against its parts, drawn one by one."""

import pytest
import torch

from cameras import pinhole, placed
from goc.raster import (
    centre_depths,
    median_splats,
    plane_channels,
    plane_depth,
    rasterize,
    render,
    render_labels,
    render_surface,
)
from goc.scene import Gaussians

VIEW = pinhole((38.0, 41.0), (50, 35), (25.0, 17.0), placed((0.2, 0.0, 0.0)))


def splats(count: int = 400) -> Gaussians:
    generator = torch.Generator().manual_seed(0)
    return Gaussians(
        means=torch.randn(count, 3, generator=generator) * 0.6 + torch.tensor([0.0, 0.0, 2.5]),
        quats=torch.randn(count, 4, generator=generator),
        log_scales=torch.randn(count, 3, generator=generator) * 0.5 - 2.2,
        opacity_logits=torch.randn(count, generator=generator),
        sh=torch.zeros(count, 4, 3),
    )


@pytest.mark.parametrize("ids", [5, 40])
def test_a_surface_is_its_parts(ids):
    gaussians = splats()
    labels = (torch.arange(len(gaussians)) % ids - 1).to(torch.int16)
    found, shown = render_surface(gaussians, labels, VIEW, min_alpha=0.4), render(gaussians, VIEW)
    assert torch.equal(found.alpha, shown.alpha)
    assert torch.equal(found.ids, render_labels(gaussians, labels, VIEW, 0.4))
    assert len(torch.unique(found.ids)) > ids // 2
    halves = median_splats(gaussians, VIEW)
    planes = plane_depth(plane_channels(gaussians, VIEW)[halves.clamp_min(0).long()], VIEW)
    assert torch.equal(found.median_depth.isnan(), (halves < 0) | planes.isnan()) and (halves >= 0).any()
    torch.testing.assert_close(found.median_depth[halves >= 0], planes[halves >= 0], equal_nan=True)
    torch.testing.assert_close(found.plane_depth, shown.plane_depth, equal_nan=True)
    seen = shown.alpha > 0.01
    away = (centre_depths(gaussians, VIEW)[:, None] - shown.depth[17, 25]).square()
    spread = (rasterize(gaussians, VIEW, away)[0][17, 25, 0] / shown.alpha[17, 25]).sqrt()  # of one pixel
    torch.testing.assert_close(found.mixed[17, 25], spread / shown.depth[17, 25], rtol=1e-3, atol=1e-4)
    assert (found.mixed[seen] > 0.02).any() and (found.mixed[seen] < 0.02).any()


def test_without_labels_there_are_no_ids():
    assert render_surface(splats(), None, VIEW).ids is None
