"""Fused losses against their definitions, and what they say in closed form."""

from dataclasses import replace

import pytest
import torch

from goc.reconstruct.losses import GeometryPrior, geometry_loss, identity_loss, photometric_loss
from goc.scene import Camera
from oracles import losses as oracle


def camera(width: int = 23, height: int = 17) -> Camera:
    return Camera(
        focal_px=torch.tensor([21.0, 19.0]),
        centre_px=torch.tensor([11.0, 9.2]),
        width=width,
        height=height,
        world_from_cam=torch.eye(4),
    )


def random_view(seed: int) -> tuple[torch.Tensor, torch.Tensor, GeometryPrior]:
    generator = torch.Generator().manual_seed(seed)
    alpha = torch.rand(17, 23, generator=generator) * 0.8 + 0.2
    blended = alpha * (2.0 + 0.3 * torch.rand(17, 23, generator=generator))
    depth = 2.0 + 0.3 * torch.rand(17, 23, generator=generator)
    normals = torch.nn.functional.normalize(torch.randn(17, 23, 3, generator=generator), dim=-1)
    depth[3:5, 4:9] = torch.nan
    normals[10:13, 2:7] = torch.nan
    return blended, alpha, GeometryPrior(depth=depth, normals=normals)


@pytest.mark.parametrize("ssim_weight", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("shape", [(31, 40), (5, 300), (64, 7)])
def test_photometric_loss_and_gradient_match_the_definition(ssim_weight, shape):
    generator = torch.Generator().manual_seed(1)
    image, target = torch.rand(*shape, 3, generator=generator), torch.rand(*shape, 3, generator=generator)
    fast, slow = image.clone().requires_grad_(), image.double().requires_grad_()
    loss = photometric_loss(fast, target, ssim_weight)
    expected = oracle.photometric(slow, target.double(), ssim_weight)
    loss.backward()
    expected.backward()
    assert loss.item() == pytest.approx(expected.item(), abs=1e-6)
    assert torch.allclose(fast.grad.double(), slow.grad, atol=1e-6 * slow.grad.abs().max().item() + 1e-9, rtol=1e-3)


def test_photometric_loss_of_equal_images_is_zero():
    image = torch.rand(20, 20, 3)
    assert photometric_loss(image, image.clone(), 0.2).item() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("weights", [(1.0, 0.0), (0.0, 1.0), (0.3, 0.1)])
def test_geometry_loss_and_gradient_match_the_definition(weights):
    blended, alpha, prior = random_view(2)
    fast = [blended.clone().requires_grad_(), alpha.clone().requires_grad_()]
    slow = [blended.double().requires_grad_(), alpha.double().requires_grad_()]
    loss = geometry_loss(*fast, prior, camera(), *weights)
    depth = slow[0] / slow[1]
    expected = weights[0] * oracle.depth_loss(depth, prior.depth.double())
    expected = expected + weights[1] * oracle.depth_normal_loss(
        depth, prior.normals.double(), slow[1].detach(), camera()
    )
    loss.backward()
    expected.backward()
    assert loss.item() == pytest.approx(expected.item(), rel=1e-5)
    for a, b in zip(fast, slow, strict=True):
        assert torch.allclose(a.grad.double(), b.grad, atol=1e-5 * b.grad.abs().max().item())


def test_depth_normal_loss_spans_agreement_to_opposition():
    depth, alpha = torch.full((17, 23), 2.0), torch.ones(17, 23)
    facing = torch.tensor([0.0, 0.0, -1.0]).expand(17, 23, 3)
    for normals, expected in ((facing, 0.0), (-facing, 2.0)):
        loss = geometry_loss(depth, alpha, GeometryPrior(depth=depth, normals=normals), camera(), 0.0, 1.0)
        assert loss.item() == pytest.approx(expected, abs=1e-6)


def test_pixels_that_show_nothing_do_not_count():
    depth = torch.full((17, 23), 2.0)
    alpha = torch.ones(17, 23)
    alpha[:, :11] = 0.05
    prior = GeometryPrior(depth=depth + 0.5, normals=None)
    assert geometry_loss(depth * alpha, alpha, prior, camera(), 1.0, 0.0).item() == pytest.approx(0.5, rel=1e-5)
    nothing = replace(prior, depth=torch.full((17, 23), torch.nan))
    assert geometry_loss(depth * alpha, alpha, nothing, camera(), 1.0, 1.0).item() == 0.0


def test_identity_loss_ignores_unlabelled_pixels():
    logits = torch.tensor([[4.0, 0.0], [0.0, 4.0], [0.0, 0.0]])
    classes = torch.tensor([0, 1, -1], dtype=torch.int16)
    expected = torch.log1p(torch.exp(torch.tensor(-4.0)))
    assert identity_loss(logits, classes).item() == pytest.approx(expected.item(), rel=1e-5)
    assert identity_loss(logits, torch.full((3,), -1, dtype=torch.int16)).item() == 0.0
