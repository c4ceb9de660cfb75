"""Native losses against their twins in PyTorch (double precision), and what they say in closed form."""

from dataclasses import replace

import pytest
import torch

from cameras import pinhole
from goc.device import CPU
from goc.raster import Views, views_of
from goc.reconstruct.losses import (
    GeometryPrior,
    RenderedDepth,
    geometry_loss,
    identity_loss,
    photometric_loss,
    rendered_depth,
    stacked_priors,
)
from goc.reconstruct.losses.geometry import unit_normals
from goc.reconstruct.losses.photometric import photometric

VIEW = pinhole((21.0, 19.0), (23, 17), (11.0, 9.2))


def looking(count: int = 1) -> Views:
    return views_of([VIEW] * count, CPU)


def expected_depth(blended: torch.Tensor, alpha: torch.Tensor) -> RenderedDepth:
    return rendered_depth(blended[None, None], alpha[None], looking())


def random_view(seed: int) -> tuple[torch.Tensor, torch.Tensor, GeometryPrior]:
    generator = torch.Generator().manual_seed(seed)
    alpha = torch.rand(17, 23, generator=generator) * 0.8 + 0.2
    blended = alpha * (2.0 + 0.3 * torch.rand(17, 23, generator=generator))
    depth = 2.0 + 0.3 * torch.rand(17, 23, generator=generator)
    normals = torch.nn.functional.normalize(torch.randn(17, 23, 3, generator=generator), dim=-1)
    depth[3:5, 4:9] = torch.nan
    normals[10:13, 2:7] = torch.nan
    return blended, alpha, GeometryPrior(depth=depth[None], normals=normals[None])


@pytest.mark.parametrize("ssim_weight", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("shape", [(1, 31, 40), (1, 5, 300), (3, 64, 7), (1, 203, 33), (2, 1, 1)])
def test_photometric_loss_and_gradient_match_the_twin(ssim_weight, shape):
    generator = torch.Generator().manual_seed(1)
    views, height, width = shape
    image = torch.rand(views, 3, height, width, generator=generator) * 1.2 - 0.1
    target = (torch.rand(*shape, 3, generator=generator) * 255).to(torch.uint8)
    fast, slow = image.clone().requires_grad_(), image.double().requires_grad_()
    loss, square_error = photometric_loss(fast, target, ssim_weight)
    expected, expected_error = photometric_loss(slow, target, ssim_weight)
    loss.backward()
    expected.backward()
    assert loss.item() == pytest.approx(expected.item(), abs=1e-6)
    assert torch.allclose(fast.grad.double(), slow.grad, atol=2e-6 * slow.grad.abs().max().item() + 1e-9, rtol=1e-3)
    assert square_error.item() == pytest.approx(expected_error.item(), rel=1e-5)


def test_ssim_is_that_of_a_dense_window():
    """The twin blurs by rows and columns; the definition is an 11×11 window."""
    x, y = torch.rand(2, 1, 3, 19, 23, dtype=torch.float64)
    taps = torch.exp(-(torch.arange(-5, 6, dtype=torch.float64) ** 2) / 4.5)
    window = torch.outer(taps, taps)[None, None] / taps.sum() ** 2
    mx, my, xx, yy, xy = (
        torch.nn.functional.conv2d(image.view(3, 1, 19, 23), window, padding=5) for image in (x, y, x * x, y * y, x * y)
    )
    ssim = (2 * mx * my + 1e-4) * (2 * (xy - mx * my) + 9e-4)
    ssim = ssim / ((mx**2 + my**2 + 1e-4) * (xx - mx**2 + yy - my**2 + 9e-4))
    found, _ = photometric(x, y, 1.0)
    assert found.item() == pytest.approx(1 - ssim.mean().item(), rel=1e-9)


def test_photometric_loss_of_equal_images_is_zero():
    target = (torch.rand(20, 20, 3) * 255).to(torch.uint8)
    loss, square_error = photometric_loss(target.permute(2, 0, 1)[None] / 255, target[None], 0.2)
    assert loss.item() == pytest.approx(0.0, abs=1e-6) and square_error.item() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("weights", [(1.0, 0.0), (0.0, 1.0), (0.3, 0.1)])
@pytest.mark.parametrize("count", [1, 3])
def test_geometry_loss_and_gradient_match_the_twin(weights, count):
    numerators, denominators, priors = zip(*(random_view(seed) for seed in range(count)), strict=True)
    numerator, denominator, prior = torch.stack(numerators), torch.stack(denominators), stacked_priors(priors)
    alpha = torch.rand(count, 17, 23) * 0.95 + 0.05  # some below 0.1: those show nothing
    denominator[0, 5, 5:8] = 0.001
    fast = [numerator.clone().requires_grad_(), denominator.clone().requires_grad_()]
    slow = [numerator.double().requires_grad_(), denominator.double().requires_grad_()]
    rendered = RenderedDepth(numerator=fast[0], denominator=fast[1], alpha=alpha)
    loss = geometry_loss(rendered, prior, looking(count), *weights)
    exact = RenderedDepth(numerator=slow[0], denominator=slow[1], alpha=alpha.double())
    expected = geometry_loss(exact, prior, looking(count), *weights)
    loss.backward()
    expected.backward()
    assert loss.item() == pytest.approx(expected.item(), rel=1e-5)
    for a, b in zip(fast, slow, strict=True):
        assert torch.allclose(a.grad.double(), b.grad, atol=1e-5 * b.grad.abs().max().item())


def test_plane_depth_of_a_slanted_plane_is_exact_where_expected_depth_is_of_its_centre():
    normal = torch.nn.functional.normalize(torch.tensor([0.4, 0.1, -1.0]), dim=0)
    rays, alpha = VIEW.rays(), torch.full((17, 23), 0.7)
    truth = -2.0 / (rays @ normal)
    blended = torch.cat([normal[:, None, None].expand(3, 17, 23), torch.full((1, 17, 23), -2.0)]) * alpha
    planes = rendered_depth(blended[None], alpha[None], looking())
    assert torch.allclose(planes.numerator / planes.denominator, truth[None], rtol=1e-5)
    centre = expected_depth(2.2 * alpha, alpha)
    assert torch.allclose(centre.numerator / centre.denominator, torch.full((1, 17, 23), 2.2))


@pytest.mark.parametrize("count", [1, 2])
def test_the_fraction_of_planes_has_the_gradient_of_its_definition(count):
    fast, (rays, alpha) = torch.randn(count, 4, 17, 23).requires_grad_(), (VIEW.rays(), torch.ones(17, 23))
    slow, alpha = fast.detach().clone().requires_grad_(), alpha.expand(count, 17, 23)
    found, upstream = rendered_depth(fast, alpha, looking(count)), torch.randn(2, count, 17, 23)
    twin = rendered_depth(fast.detach().double(), alpha, looking(count))
    expected = -slow[:, 3], -(slow[:, :3].permute(0, 2, 3, 1) * rays).sum(-1)
    assert torch.equal(twin.numerator.float(), expected[0])
    assert torch.allclose(twin.denominator.float(), expected[1], atol=1e-5)
    assert torch.allclose(found.numerator, expected[0])
    assert torch.allclose(found.denominator, expected[1], atol=1e-5)
    torch.autograd.backward((found.numerator, found.denominator), tuple(upstream))
    torch.autograd.backward(expected, tuple(upstream))
    assert torch.allclose(fast.grad, slow.grad, atol=1e-5)


def test_packed_normals_are_the_same_normals():
    numerator, denominator, prior = random_view(4)
    rendered = expected_depth(numerator, denominator)
    packed = torch.nan_to_num(prior.normals * 127).round().to(torch.int8)
    unpacked = torch.nn.functional.normalize(packed.float(), dim=-1)
    unpacked = torch.where((packed == 0).all(-1, keepdim=True), torch.nan, unpacked)
    losses = [geometry_loss(rendered, replace(prior, normals=n), looking(), 0.3, 0.7) for n in (packed, unpacked)]
    assert losses[0].item() == pytest.approx(losses[1].item(), rel=1e-6)
    found = unit_normals(packed)
    assert torch.equal(torch.isnan(found), torch.isnan(unpacked)) and unit_normals(unpacked) is unpacked
    assert (found - unpacked).nan_to_num().abs().max() < 1e-6


def test_priors_of_several_views_are_stacked_and_none_is_nowhere():
    prior = random_view(5)[2]
    packed = replace(prior, normals=torch.nan_to_num(prior.normals * 127).round().to(torch.int8))
    assert stacked_priors([None, None]) is None and stacked_priors([packed]) is packed
    found = stacked_priors([None, packed, replace(prior, normals=None)])
    assert torch.isnan(found.depth[0]).all() and torch.isnan(found.normals[[0, 2]]).all()
    assert torch.equal(found.depth[1:].nan_to_num(), prior.depth.expand(2, 17, 23).nan_to_num())
    assert (found.normals[1] - prior.normals[0]).nan_to_num().abs().max() < 0.01
    assert stacked_priors([None, replace(prior, normals=None)]).normals is None


def test_depth_normal_loss_spans_agreement_to_opposition():
    depth, alpha = torch.full((17, 23), 2.0), torch.ones(17, 23)
    facing = torch.tensor([0.0, 0.0, -1.0]).expand(17, 23, 3)
    for normals, expected in ((facing, 0.0), (-facing, 2.0)):
        loss = geometry_loss(
            expected_depth(depth, alpha), GeometryPrior(depth=depth[None], normals=normals[None]), looking(), 0.0, 1.0
        )
        assert loss.item() == pytest.approx(expected, abs=1e-6)


def test_pixels_that_show_nothing_do_not_count():
    depth = torch.full((17, 23), 2.0)
    alpha = torch.ones(17, 23)
    alpha[:, :11] = 0.05
    prior = GeometryPrior(depth=depth[None] + 0.5, normals=None)
    nothing = replace(prior, depth=torch.full((1, 17, 23), torch.nan))
    shown = expected_depth(depth * alpha, alpha)
    assert geometry_loss(shown, prior, looking(), 1.0, 0.0).item() == pytest.approx(0.5, rel=1e-5)
    assert geometry_loss(shown, nothing, looking(), 1.0, 1.0).item() == 0.0


def test_identity_loss_ignores_unlabelled_pixels():
    logits = torch.tensor([[[4.0, 0.0], [0.0, 4.0], [0.0, 0.0]]])
    classes = torch.tensor([[0, 1, -1]], dtype=torch.int16)
    expected = torch.log1p(torch.exp(torch.tensor(-4.0)))
    assert identity_loss(logits, classes).item() == pytest.approx(expected.item(), rel=1e-5)
    blank = torch.full((1, 3), -1, dtype=torch.int16)
    assert identity_loss(logits, blank).item() == 0.0
    # a view counts as much as another one, however many of its pixels are labelled
    both = identity_loss(torch.cat([logits, logits]), torch.cat([classes, blank]))
    assert both.item() == pytest.approx(expected.item() / 2, rel=1e-5)
