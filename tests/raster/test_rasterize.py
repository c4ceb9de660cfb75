"""The native engine against its slow twin, finite differences, and the laws it must keep."""

from dataclasses import replace

import pytest
import torch

from cameras import pinhole, turned
from goc import _native
from goc.raster import median_splats, rasterize
from goc.scene import Camera, Gaussians
from oracles import splatting

GEOMETRY = ("means", "quats", "log_scales", "opacity_logits")


def camera(width: int = 40, height: int = 28) -> Camera:
    pose = turned((0.98, 0.1, -0.12, 0.07), (0.1, -0.2, 0.3))
    return pinhole((38.0, 41.0), (width, height), (19.3, 14.8), pose)


def random_splats(count: int, seed: int = 0, opacity: float = 0.0) -> Gaussians:
    generator = torch.Generator().manual_seed(seed)
    spread = torch.rand(count, 3, generator=generator)
    return Gaussians(
        means=(spread - 0.5) * torch.tensor([3.0, 2.4, 2.0]) + torch.tensor([0.0, 0.0, 2.6]),
        quats=torch.randn(count, 4, generator=generator),
        log_scales=torch.randn(count, 3, generator=generator) * 0.6 - 2.4,
        opacity_logits=torch.randn(count, generator=generator) * 1.5 + opacity,
        sh=torch.zeros(count, 1, 3),
    )


def double(gaussians: Gaussians) -> Gaussians:
    return Gaussians(**{name: getattr(gaussians, name).detach().double() for name in (*GEOMETRY, "sh")})


def with_gradients(gaussians: Gaussians) -> Gaussians:
    return replace(gaussians, **{name: getattr(gaussians, name).detach().clone().requires_grad_() for name in GEOMETRY})


@pytest.mark.parametrize("channel_count", [1, 3, 8, 11, 40])
@pytest.mark.parametrize("opacity", [0.0, 4.0])
def test_rasterize_matches_the_oracle(channel_count, opacity):
    gaussians = random_splats(150, seed=channel_count, opacity=opacity)
    channels = torch.randn(150, channel_count)
    image, alpha = rasterize(gaussians, camera(), channels)
    expected, expected_alpha = splatting.rasterize(double(gaussians), camera(), channels.double())
    # A pixel whose alpha lies within float32 of 1/255 may fall on either side: allow one such step.
    assert (image - expected).abs().max() < 2e-2
    assert (image - expected).abs().mean() < 2e-5
    assert (alpha - expected_alpha).abs().mean() < 1e-5


@pytest.mark.parametrize("channel_count", [1, 4, 9, 35])
def test_gradients_match_the_oracle(channel_count):
    gaussians, channels = with_gradients(random_splats(60, seed=3)), torch.randn(60, channel_count).requires_grad_()
    image_grad, alpha_grad = torch.randn(28, 40, channel_count), torch.randn(28, 40)
    torch.autograd.backward(rasterize(gaussians, camera(), channels), (image_grad, alpha_grad))
    slow, slow_channels = with_gradients(double(gaussians)), channels.detach().double().requires_grad_()
    torch.autograd.backward(
        splatting.rasterize(slow, camera(), slow_channels), (image_grad.double(), alpha_grad.double())
    )
    pairs = {name: (getattr(gaussians, name).grad, getattr(slow, name).grad) for name in GEOMETRY}
    pairs["channels"] = (channels.grad, slow_channels.grad)
    for name, (fast, exact) in pairs.items():
        # Relative to the largest: single splats may cross the 1/255 threshold at a pixel.
        assert (fast - exact).abs().max() < 3e-3 * exact.abs().max(), name
        assert (fast - exact).abs().mean() < 1e-4 * exact.abs().max(), name


def test_oracle_gradient_agrees_with_finite_differences():
    gaussians, channels = double(random_splats(6, seed=1)), torch.randn(6, 2, dtype=torch.float64)

    def blend(means, quats, log_scales, logits):
        splats = replace(gaussians, means=means, quats=quats, log_scales=log_scales, opacity_logits=logits)
        image, alpha = splatting.rasterize(splats, camera(12, 9), channels)
        return image.sin().mean() + alpha.cos().mean()

    inputs = [getattr(gaussians, name).clone().requires_grad_() for name in GEOMETRY]
    assert torch.autograd.gradcheck(blend, inputs, eps=1e-7, atol=1e-4)


def test_channel_gradients_are_votes():
    """With one-hot masks upstream, the gradient of channels is Σ_p w(g, p)·onehot(p)."""
    gaussians, channels = random_splats(40, seed=5), torch.zeros(40, 3, requires_grad=True)
    ids = torch.randint(0, 3, (28, 40))
    image, _ = rasterize(gaussians, camera(), channels)
    image.backward(torch.nn.functional.one_hot(ids, 3).float())
    weights = splatting.rasterize(double(gaussians), camera(), torch.eye(40, dtype=torch.float64))[0]
    expected = torch.einsum("hwn,hwc->nc", weights, torch.nn.functional.one_hot(ids, 3).double())
    assert torch.allclose(channels.grad.double(), expected, atol=5e-3)


def test_thread_count_does_not_change_a_bit():
    gaussians, channels = random_splats(400, seed=2), torch.randn(400, 5)
    results, before = [], _native.thread_count()
    for threads in (1, 2, 5):
        _native.set_thread_count(threads)
        splats, colours = with_gradients(gaussians), channels.clone().requires_grad_()
        image, alpha = rasterize(splats, camera(200, 150), colours)
        torch.autograd.backward((image, alpha), (torch.ones_like(image), torch.ones_like(alpha)))
        results.append([image, alpha, colours.grad, *(getattr(splats, name).grad for name in GEOMETRY)])
    _native.set_thread_count(before)
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_image_moves_with_the_world():
    """A rigid motion of splats and camera together changes nothing."""
    gaussians, channels = random_splats(80, seed=7), torch.randn(80, 3)
    motion = torch.eye(4)
    motion[:3, :3] = splatting.rotation_matrices(torch.tensor([[0.6, -0.4, 0.5, 0.48]]))[0]
    motion[:3, 3] = torch.tensor([1.0, 2.0, -0.5])
    turn = torch.tensor([0.6, -0.4, 0.5, 0.48])
    w, v = gaussians.quats[:, :1], gaussians.quats[:, 1:]
    turned = torch.cat(
        [turn[0] * w - v @ turn[1:, None], turn[0] * v + w * turn[1:] + torch.linalg.cross(turn[1:].expand_as(v), v)], 1
    )
    moved = replace(gaussians, means=gaussians.means @ motion[:3, :3].T + motion[:3, 3], quats=turned)
    seen = replace(camera(), world_from_cam=motion @ camera().world_from_cam)
    before, after = rasterize(gaussians, camera(), channels)[0], rasterize(moved, seen, channels)[0]
    assert (before - after).abs().max() < 2e-2
    assert (before - after).abs().mean() < 1e-5


def test_single_opaque_splat_in_closed_form():
    """At its centre a splat shows opacity times its colour."""
    splat = Gaussians(
        means=torch.tensor([[0.0, 0.0, 2.0]]),
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        log_scales=torch.full((1, 3), -1.0),
        opacity_logits=torch.tensor([1.0]),
        sh=torch.zeros(1, 1, 3),
    )
    view = pinhole(50.0, (21, 17))
    image, alpha = rasterize(splat, view, torch.tensor([[3.0]]))
    opacity = torch.tensor(1.0).sigmoid()
    assert alpha[8, 10] == pytest.approx(opacity.item(), rel=1e-5)
    assert image[8, 10, 0] == pytest.approx(3 * opacity.item(), rel=1e-5)
    sigma_px = torch.e**-1 * 50 / 2
    expected = opacity * torch.exp(torch.tensor(-0.5 * 4**2 / (sigma_px**2 + _native.DILATION)))
    assert alpha[8, 14] == pytest.approx(expected.item(), rel=1e-4)


def test_nothing_in_view_is_empty():
    behind = replace(random_splats(10), means=torch.full((10, 3), -5.0))
    image, alpha = rasterize(behind, camera(), torch.ones(10, 2))
    assert not image.any() and not alpha.any()


def test_channels_must_match_the_splats():
    with pytest.raises(ValueError, match="channels has 3 rows for 10 splats"):
        rasterize(random_splats(10), camera(), torch.ones(3, 2))


def test_median_splat_is_where_the_oracle_turns_half_opaque():
    gaussians = random_splats(120, seed=11, opacity=1.0)
    found = median_splats(gaussians, camera())
    weights, _ = splatting.rasterize(double(gaussians), camera(), torch.eye(120, dtype=torch.float64))
    order = torch.argsort(splatting.project(double(gaussians), camera())[2])
    passed = 1 - weights[..., order].cumsum(-1) < 0.5
    expected = torch.where(passed.any(-1), order[passed.int().argmax(-1)], -1)
    assert (found == expected).float().mean() > 0.995  # ties at one half and at alpha 1/255 may fall either way
    assert (found >= 0).any() and (found < 0).any()
