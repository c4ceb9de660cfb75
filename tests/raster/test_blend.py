"""The fused view of a training step against the general engine and the channels it stands for."""

from dataclasses import fields, replace

import pytest
import torch

from cameras import pinhole, turned
from goc import _native
from goc.device import CPU
from goc.geometry.harmonics import colours_towards
from goc.raster import NATIVE, BlendedViews, blend_views, centre_depths, plane_channels, rasterize, views_of
from goc.scene import Camera, Gaussians

VIEW = pinhole((38.0, 41.0), (43, 29), (19.3, 14.8), turned((0.98, 0.1, -0.12, 0.07), (0.1, -0.2, 0.3)))


def blend_view(gaussians: Gaussians, view: Camera, planes: bool) -> BlendedViews:
    return blend_views(gaussians, views_of([view], CPU), planes, NATIVE)


def random_splats(count: int, degree: int, features: int) -> Gaussians:
    generator = torch.Generator().manual_seed(degree)
    spread = torch.rand(count, 3, generator=generator)
    arrays = {
        "means": (spread - 0.5) * torch.tensor([3.4, 2.4, 2.0]) + torch.tensor([0.0, 0.0, 2.4]),
        "quats": torch.randn(count, 4, generator=generator),
        "log_scales": torch.randn(count, 3, generator=generator) * 0.6 - 2.4,
        "opacity_logits": torch.randn(count, generator=generator) * 1.5,
        "sh": torch.randn(count, (degree + 1) ** 2, 3, generator=generator) * 0.5,
        "identity": torch.randn(count, features, generator=generator) if features else None,
    }
    return Gaussians(**{name: value if value is None else value.requires_grad_() for name, value in arrays.items()})


def gradients(gaussians: Gaussians) -> dict[str, torch.Tensor]:
    values = {item.name: getattr(gaussians, item.name) for item in fields(Gaussians)}
    return {name: value.grad for name, value in values.items() if value is not None}


def copy(gaussians: Gaussians) -> Gaussians:
    values = {item.name: getattr(gaussians, item.name) for item in fields(Gaussians)}
    return replace(
        gaussians,
        **{name: None if value is None else value.detach().requires_grad_() for name, value in values.items()},
    )


@pytest.mark.parametrize("planes", [True, False])
@pytest.mark.parametrize(("degree", "features"), [(0, 0), (1, 0), (2, 5), (3, 0), (1, 30)])
def test_a_view_is_its_channels_rasterised(planes, degree, features):
    fast = random_splats(120, degree, features)
    slow, view = copy(fast), VIEW
    channels = [
        colours_towards(slow.sh, slow.means, view.position),
        plane_channels(slow, view) if planes else centre_depths(slow, view)[:, None],
    ]
    if slow.identity is not None:
        channels.append(slow.identity)
    expected, expected_alpha = rasterize(slow, view, torch.cat(channels, -1))
    found = blend_view(fast, view, planes)
    images = [found.colour, found.geometry] + ([] if found.features is None else [found.features])
    image = torch.cat(images, 1)[0].permute(1, 2, 0)
    assert (image - expected).abs().max() < 2e-5
    assert torch.equal(found.alpha[0], expected_alpha)
    upstream, alpha_upstream = torch.randn_like(image), torch.randn_like(expected_alpha)
    torch.autograd.backward((image, found.alpha[0]), (upstream, alpha_upstream))
    torch.autograd.backward((expected, expected_alpha), (upstream, alpha_upstream))
    for name, exact in gradients(slow).items():
        assert (gradients(fast)[name] - exact).abs().max() < 2e-5 * exact.abs().max(), name


@pytest.mark.parametrize("planes", [True, False])
def test_several_views_are_each_of_them_on_either_kind_of_engine(planes):
    """Fused: view after view. Not: channels in PyTorch, which are blended together."""
    cameras = [VIEW, replace(VIEW, world_from_cam=torch.eye(4))]
    alone, fused, plain = (random_splats(120, 2, 5) for _ in range(3))
    parts = [blend_view(alone, one, planes) for one in cameras]
    together = [
        blend_views(splats, views_of(cameras, CPU), planes, replace(NATIVE, fused=is_fused))
        for splats, is_fused in ((fused, True), (plain, False))
    ]
    for name in ("colour", "geometry", "features", "alpha"):
        expected = torch.cat([getattr(part, name) for part in parts])
        assert torch.equal(getattr(together[0], name), expected), name
        assert torch.allclose(getattr(together[1], name), expected, atol=2e-5), name
    for shown in (*parts, *together):
        (shown.colour.square().sum() + shown.geometry.square().sum() + shown.features.square().sum()).backward()
    for name, exact in gradients(alone).items():
        for splats in (fused, plain):
            assert (gradients(splats)[name] - exact).abs().max() < 2e-5 * exact.abs().max(), name


def test_an_image_that_no_loss_looks_at_has_no_part_in_the_gradient():
    fast, view = random_splats(120, 1, 0), VIEW
    slow = copy(fast)
    blend_view(fast, view, True).colour.square().sum().backward()
    image, _ = rasterize(slow, view, colours_towards(slow.sh, slow.means, view.position))
    image.square().sum().backward()
    for name, exact in gradients(slow).items():
        assert (gradients(fast)[name] - exact).abs().max() < 2e-5 * exact.abs().max(), name


def test_a_view_is_differentiated_once():
    shown = blend_view(random_splats(10, 0, 0), VIEW, True)
    shown.alpha.sum().backward(retain_graph=True)
    with pytest.raises(RuntimeError, match="can be differentiated once"):
        shown.alpha.sum().backward()


def test_thread_count_does_not_change_a_bit():
    results, before = [], _native.thread_count()
    for threads in (1, 2, 5):
        _native.set_thread_count(threads)
        gaussians = random_splats(4000, 1, 0)
        shown = blend_view(gaussians, replace(VIEW, width=201, height=150), True)
        (shown.colour.square().sum() + shown.geometry.square().sum() + shown.alpha.sum()).backward()
        results.append([shown.colour, shown.geometry, shown.alpha, *gradients(gaussians).values()])
    _native.set_thread_count(before)
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_sh_must_be_whole_bands():
    with pytest.raises(ValueError, match="degree 0 to 3"):
        blend_view(replace(random_splats(10, 0, 0), sh=torch.zeros(10, 2, 3)), VIEW, True)
