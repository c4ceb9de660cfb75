"""L_pho and L_geo: against their twin, by finite differences, in closed form."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from cameras import pinhole, placed
from goc import _native
from goc.device import CPU
from goc.raster import views_of
from goc.reconstruct.losses import Neighbour, PairWeights, RenderedDepth, inverse_depth
from goc.reconstruct.losses import multiview_loss as loss_of_pair
from goc.scene import Camera, Frame

TOLERANCE = 0.05


def camera(position: tuple[float, float, float], yaw: float = 0.0, size: tuple[int, int] = (46, 38)) -> Camera:
    """Before a wall at z ≈ 2, looking along z."""
    scale = size[0] / 46
    return pinhole((40.0 * scale, 38.0 * scale), size, (size[0] / 2 + 0.3, size[1] / 2 - 0.4), placed(position, yaw))


def wall_depth(view: Camera, slope: float = 0.25, z: float = 2.0) -> Tensor:
    """Exact z of the plane z_world = z + slope·x_world."""
    rays = view.rays().double() @ view.world_from_cam[:3, :3].T.double()
    eye = view.position.double()
    return ((z + slope * eye[0] - eye[2]) / (rays[..., 2] - slope * rays[..., 0])).float()


def photograph(view: Camera, depth: Tensor) -> Tensor:
    """A texture on the wall, as bytes."""
    rays = view.rays() * depth[..., None]
    points = rays @ view.world_from_cam[:3, :3].T + view.position
    waves = torch.sin(points @ torch.tensor([[4.0, 1.0, 6.0], [-2.0, 5.0, 3.0], [0.5, 0.4, -1.0]]))
    return (127.5 + 110 * waves).round().to(torch.uint8)


def pair(size: tuple[int, int] = (51, 40), slope: float = 0.25) -> tuple[Frame, Tensor, Frame, Tensor]:
    """Two photographs of the wall and their exact depths."""
    here, there = camera((0.0, 0.0, 0.0)), camera((0.35, 0.05, 0.1), -0.12, size)
    depths = wall_depth(here, slope), wall_depth(there, slope)
    frames = [
        Frame(camera=view, image=photograph(view, depth)) for view, depth in zip((here, there), depths, strict=True)
    ]
    return frames[0], depths[0], frames[1], depths[1]


def neighbour_of(frame: Frame, inverse: Tensor, stride: int = 1) -> Neighbour:
    return Neighbour(views=views_of([frame.camera], CPU), image=frame.image, inverse_depth=inverse, stride=stride)


def expected_depth(blended: Tensor, alpha: Tensor) -> RenderedDepth:
    return RenderedDepth(numerator=blended[None], denominator=alpha[None], alpha=alpha[None])


def multiview_loss(depth: RenderedDepth, frame: Frame, neighbour: Neighbour, weights: PairWeights) -> Tensor:
    return loss_of_pair(depth, views_of([frame.camera], CPU), frame.image, neighbour, weights)


def perturbed(depth: Tensor, amount: float, seed: int) -> Tensor:
    return depth * (1 + amount * torch.randn(depth.shape, generator=torch.Generator().manual_seed(seed)))


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize(("photometric", "geometric"), [(1.0, 0.0), (0.0, 1.0), (0.3, 0.2)])
def test_values_and_gradients_match_the_twin(photometric, geometric, stride):
    frame, depth, other, other_depth = pair()
    other_depth = perturbed(other_depth, 0.004, 1)
    other_depth[:, 30:] *= 0.8  # something in front, with an edge
    middle = stride // 2
    inverse = (1 / other_depth)[middle::stride, middle::stride].contiguous()
    inverse[4:7, 5:8] = 0.0
    alpha = 0.4 + 0.6 * torch.rand(depth.shape, generator=torch.Generator().manual_seed(3))
    fast = [(perturbed(depth, 0.01, 2) * alpha).requires_grad_(), alpha.clone().requires_grad_()]
    slow = [values.detach().double().requires_grad_() for values in fast]
    there = inverse.clone().requires_grad_()
    slow_there = inverse.double().requires_grad_()

    weights = PairWeights(photometric=photometric, geometric=geometric, tolerance=TOLERANCE)
    loss = multiview_loss(expected_depth(fast[0], fast[1]), frame, neighbour_of(other, there, stride), weights)
    exact = replace(expected_depth(*slow), alpha=alpha.double()[None])
    expected = multiview_loss(exact, frame, neighbour_of(other, slow_there, stride), weights)
    loss.backward()
    expected.backward()
    assert loss.item() == pytest.approx(expected.item(), rel=1e-4, abs=1e-6)
    assert loss.item() > 3e-4
    found = [*(values.grad for values in fast), there.grad]
    for a, b in zip(found, [*(values.grad for values in slow), slow_there.grad], strict=True):
        b = torch.zeros_like(a, dtype=torch.float64) if b is None else b
        assert torch.allclose(a.double(), b, atol=2e-3 * b.abs().max().item())


def test_gradients_are_slopes_of_the_loss():
    frame, depth, other, other_depth = pair()
    weights = PairWeights(photometric=1.0, geometric=0.0, tolerance=TOLERANCE)
    there = neighbour_of(other, 1 / other_depth)
    alpha = torch.ones_like(depth)

    def value(shift: float, gradient: bool = False) -> tuple[float, float]:
        moved = (depth * (1.01 + shift)).requires_grad_(gradient)
        loss = multiview_loss(expected_depth(moved, alpha), frame, there, weights)
        if gradient:
            loss.backward()
            return loss.item(), (moved.grad * depth).sum().item()
        return loss.item(), 0.0

    step = 2e-4  # of the depth; small against a pixel, so that few photographs' samples cross into another cell
    slope = (value(step)[0] - value(-step)[0]) / (2 * step)
    assert value(0.0, gradient=True)[1] == pytest.approx(slope, rel=0.05)


def test_the_true_depth_explains_both_photographs():
    frame, depth, other, other_depth = pair()
    alpha, there = torch.ones_like(depth), neighbour_of(other, 1 / other_depth)
    both = PairWeights(photometric=1.0, geometric=1.0, tolerance=TOLERANCE)
    losses = [
        multiview_loss(expected_depth(depth * scale, alpha), frame, there, both).item() for scale in (0.97, 1.0, 1.03)
    ]
    assert losses[1] < 0.01
    assert min(losses[0], losses[2]) > 5 * losses[1]


def test_gradients_point_back_to_the_truth():
    frame, depth, other, other_depth = pair()
    alpha, there = torch.ones_like(depth), neighbour_of(other, 1 / other_depth)
    for weights in (
        PairWeights(photometric=1.0, geometric=0.0, tolerance=0.1),
        PairWeights(photometric=0.0, geometric=1.0, tolerance=0.1),
    ):
        for scale, sign in ((0.985, -1), (1.015, 1)):
            wrong = (depth * scale).requires_grad_()
            multiview_loss(expected_depth(wrong, alpha), frame, there, weights).backward()
            pushed = wrong.grad[wrong.grad != 0]
            assert (pushed.sign() == sign).float().mean().item() > 0.85


def test_the_way_there_and_back_is_as_long_as_a_shift_of_disparity():
    """Two cameras side by side before a wall that faces them: e = f·b·|1/D - 1/D_n|, both depths constant."""
    here, there = camera((0.0, 0.0, 0.0)), camera((0.2, 0.0, 0.0))
    frame, other = (Frame(camera=view, image=torch.zeros(38, 46, 3, dtype=torch.uint8)) for view in (here, there))
    near, far = torch.full((38, 46), 2.0), torch.full((38, 46), 2.08)
    weights = PairWeights(photometric=0.0, geometric=1.0, tolerance=TOLERANCE)
    loss = multiview_loss(expected_depth(near, torch.ones_like(near)), frame, neighbour_of(other, 1 / far), weights)
    error = 40.0 * 0.2 * (1 / 2.0 - 1 / 2.08)
    assert loss.item() == pytest.approx(math.exp(-error) * error, rel=1e-4)


def test_what_cannot_be_compared_does_not_count():
    frame, depth, other, other_depth = pair()
    alpha, inverse = torch.ones_like(depth), 1 / other_depth
    both = PairWeights(photometric=1.0, geometric=1.0, tolerance=TOLERANCE)
    wrong = depth * 1.01
    hidden = neighbour_of(other, inverse * 1.5)  # something nearer stands before everything
    away = replace(other.camera, world_from_cam=torch.diag(torch.tensor([-1.0, 1.0, -1.0, 1.0])))
    turned = neighbour_of(replace(other, camera=away), inverse)
    nothing = neighbour_of(other, torch.zeros_like(inverse))
    for there in (hidden, turned, nothing):
        moved = wrong.clone().requires_grad_()
        loss = multiview_loss(expected_depth(moved, alpha), frame, there, both)
        loss.backward()
        assert loss.item() == 0.0
        assert (moved.grad == 0).all()
    assert (
        multiview_loss(expected_depth(wrong * 0.4, alpha * 0.4), frame, neighbour_of(other, inverse), both).item()
        == 0.0
    )


def test_unknown_pixels_do_not_leak_into_their_neighbours():
    frame, depth, other, other_depth = pair()
    weights = PairWeights(photometric=1.0, geometric=0.0, tolerance=TOLERANCE)
    there = neighbour_of(other, 1 / other_depth)
    alpha = torch.ones_like(depth)
    alpha[10:20, 12:22] = 0.2
    found = []
    for garbage in (0.1, 5.0):
        shown = torch.where(alpha > 0.5, depth, garbage)
        image = torch.where(alpha[..., None] > 0.5, frame.image, int(garbage * 50)).to(torch.uint8)
        rendered = (shown * alpha).requires_grad_()
        loss = multiview_loss(expected_depth(rendered, alpha), replace(frame, image=image), there, weights)
        loss.backward()
        found.append((loss.item(), rendered.grad))
    assert found[0][0] == found[1][0]
    assert torch.equal(found[0][1], found[1][1])
    assert (found[0][1][10:20, 12:22] == 0).all()


def test_bits_do_not_depend_on_the_number_of_threads():
    frame, depth, other, other_depth = pair()
    both = PairWeights(photometric=0.3, geometric=0.3, tolerance=TOLERANCE)
    before, results = _native.thread_count(), []
    for threads in (1, 3):
        _native.set_thread_count(threads)
        moved = perturbed(depth, 0.01, 5).requires_grad_()
        inverse = (1 / other_depth).requires_grad_()
        multiview_loss(
            expected_depth(moved, torch.ones_like(depth)), frame, neighbour_of(other, inverse), both
        ).backward()
        results.append((moved.grad, inverse.grad))
    _native.set_thread_count(before)
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_inverse_depth_is_none_where_nothing_is_shown():
    numerator = torch.tensor([[2.0, 1.0, -1.0, 1.0]]).requires_grad_()
    denominator = torch.tensor([[1.0, 0.4, 1.0, 0.001]])
    depth = replace(expected_depth(numerator, denominator), alpha=torch.tensor([[[1.0, 0.4, 1.0, 1.0]]]))
    found = inverse_depth(depth)[0]
    found.sum().backward()
    assert torch.equal(found.detach(), torch.tensor([[0.5, 0.0, 0.0, 0.0]]))
    assert torch.equal(numerator.grad, torch.tensor([[-0.25, 0.0, 0.0, 0.0]]))


def test_images_of_different_sizes_are_refused():
    frame, depth, other, other_depth = pair()
    both = PairWeights(photometric=1.0, geometric=1.0, tolerance=TOLERANCE)
    cropped = replace(frame, image=frame.image[:-1].contiguous())
    with pytest.raises(ValueError, match="images must have the camera's height and width"):
        multiview_loss(
            expected_depth(depth, torch.ones_like(depth)), cropped, neighbour_of(other, 1 / other_depth), both
        )
