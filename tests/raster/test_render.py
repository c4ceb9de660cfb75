"""What a view shows: plane depth without bias, facing normals, ids by weight."""

from dataclasses import replace

import pytest
import torch

from cameras import pinhole
from goc.geometry.rotations import quats_towards
from goc.raster import centre_depths, plane_channels, plane_depth, rasterize, render, render_labels, render_surface
from goc.scene import UNLABELLED, Gaussians

VIEW = pinhole(60.0, (48, 36))


def wall(normal: torch.Tensor, distance: float, spacing: float = 0.06) -> Gaussians:
    """Flat splats all over the plane normal·x = -distance, turned away from or towards the camera at random."""
    rays = VIEW.resized(24, 18).rays().reshape(-1, 3)
    means = rays * (-distance / (rays @ normal))[:, None]
    flips = torch.where(torch.arange(len(means)) % 2 == 0, 1.0, -1.0)
    scales = torch.tensor([spacing, spacing, 0.001]).log()
    return Gaussians(
        means=means,
        quats=quats_towards(normal * flips[:, None]),
        log_scales=scales.expand(len(means), 3).contiguous(),
        opacity_logits=torch.full((len(means),), 2.0),
        sh=torch.zeros(len(means), 1, 3),
    )


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (0.6, 0.2, -1.0), (-0.9, 0.1, -0.8)])
def test_plane_depth_of_a_slanted_wall_is_exact(direction):
    normal = torch.nn.functional.normalize(torch.tensor(direction), dim=0)
    shown = render(wall(normal, 2.0), VIEW)
    truth = -2.0 / (VIEW.rays() @ normal)
    solid = shown.alpha > 0.9
    assert solid.float().mean() > 0.5
    assert torch.allclose(shown.plane_depth[solid], truth[solid], rtol=1e-3)
    assert (shown.normals[solid] @ normal).min() > 0.999
    # The depth of the centres is biased towards the camera on the slant: why meshes use the planes.
    bias = (shown.depth - truth)[solid].mean().abs()
    assert bias >= (shown.plane_depth - truth)[solid].mean().abs()


def test_plane_channels_face_the_camera():
    gaussians = wall(torch.tensor([0.0, 0.0, -1.0]), 2.0)
    channels = plane_channels(gaussians, VIEW)
    assert (channels[:, 2] < 0).all() and (channels[:, 3] < 0).all()
    assert torch.allclose(centre_depths(gaussians, VIEW), torch.full((len(gaussians),), 2.0), atol=1e-5)


def test_plane_depth_is_missing_where_planes_are_seen_from_behind_or_not_at_all():
    blended = torch.zeros(36, 48, 4)
    assert torch.isnan(plane_depth(blended, VIEW)).all()
    blended[..., 2], blended[..., 3] = 1.0, -2.0
    assert torch.isnan(plane_depth(blended, VIEW)).all()


def test_plane_depth_is_differentiable_in_the_splats():
    gaussians = wall(torch.nn.functional.normalize(torch.tensor([0.3, 0.0, -1.0]), dim=0), 2.0)
    means, quats = gaussians.means.clone().requires_grad_(), gaussians.quats.clone().requires_grad_()
    moved = replace(gaussians, means=means, quats=quats)
    image, _ = rasterize(moved, VIEW, plane_channels(moved, VIEW))
    plane_depth(image, VIEW)[10:20, 10:30].sum().backward()
    assert means.grad.abs().sum() > 0 and quats.grad.abs().sum() > 0


def test_labels_are_those_of_most_weight():
    left = wall(torch.tensor([0.0, 0.0, -1.0]), 2.0)
    labels = torch.where(left.means[:, 0] < 0, 3, 7).to(torch.int16)
    ids = render_labels(left, labels, VIEW)
    assert (ids[8:28, 8:20] == 3).all() and (ids[8:28, 28:40] == 7).all()
    assert (render_labels(left, torch.full_like(labels, UNLABELLED), VIEW)[8:28, 8:40] == UNLABELLED).all()


def test_more_labels_than_one_pass_holds():
    gaussians = wall(torch.tensor([0.0, 0.0, -1.0]), 2.0, spacing=0.02)
    labels = (torch.arange(len(gaussians)) % 24 + 24 * (torch.arange(len(gaussians)) // 24 % 2)).to(torch.int16)
    ids = render_labels(gaussians, labels, VIEW, min_alpha=0.1)
    assert len(set(torch.unique(ids).tolist()) - {UNLABELLED}) == 48
    shown = ids[17, 23]
    nearest = (gaussians.means - VIEW.rays()[17, 23] * 2.0).norm(dim=-1).argmin()
    assert shown == labels[nearest]


def test_where_little_is_rendered_there_is_no_label():
    thin = replace(wall(torch.tensor([0.0, 0.0, -1.0]), 2.0), opacity_logits=torch.full((432,), -4.0))
    ids = render_labels(thin, torch.ones(432, dtype=torch.int16), VIEW)
    assert (ids == UNLABELLED).all()


def test_mixed_pixels_are_told():
    facing = torch.tensor([0.0, 0.0, -1.0])
    near, far = wall(facing, 1.0), wall(facing, 3.0, spacing=0.2)
    both = Gaussians(
        **{
            name: torch.cat([getattr(near, name), getattr(far, name)])
            for name in ("means", "quats", "log_scales", "sh")
        },
        opacity_logits=torch.cat([torch.full((432,), -2.0), torch.full((432,), 6.0)]),
    )
    middle = (slice(10, 26), slice(12, 36))
    assert render_surface(far, None, VIEW).mixed[middle].max() < 0.01
    mixed, depth = render_surface(both, None, VIEW).mixed, render(both, VIEW).depth
    share = (3.0 - depth) / 2.0  # of the near wall
    assert torch.allclose((mixed * depth)[middle], (2.0 * (share * (1 - share)).sqrt())[middle], atol=0.02)
    assert mixed[middle].min() > 0.04


def test_median_depth_does_not_fly_between_two_surfaces():
    facing = torch.tensor([0.0, 0.0, -1.0])
    near, far = wall(facing, 1.0), wall(facing, 3.0, spacing=0.2)
    near = near[near.means[:, 0] < 0]
    both = Gaussians(
        **{
            name: torch.cat([getattr(near, name), getattr(far, name)])
            for name in ("means", "quats", "log_scales", "opacity_logits", "sh")
        }
    )
    depth = render_surface(both, None, VIEW).median_depth[10:26, 6:42]
    on_one = ((depth - 1.0).abs() < 0.01) | ((depth - 3.0).abs() < 0.03)
    assert on_one.all()
    blended = render(both, VIEW).plane_depth[10:26, 6:42]
    assert ((blended > 1.1) & (blended < 2.7)).any()
