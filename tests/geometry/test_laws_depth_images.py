"""Depth images: filling holes and fitting monocular depth commute with what they should."""

import pytest
import torch

from goc.geometry.alignment import CELLS, align, aligned_depth, cell_means, slow_errors, spread
from goc.geometry.inpaint import filled
from laws import SCALES, over

SHAPES = {"pixel": (1, 1), "row": (1, 9), "column": (7, 1), "odd": (13, 7), "even": (16, 32)}


def holed(shape: tuple[int, int], share=0.5, seed=0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    image = 1 + torch.rand(shape, generator=generator)
    image[torch.rand(shape, generator=generator) < share] = torch.nan
    image.view(-1)[0] = 1.5
    return image


@over(shape=SHAPES)
@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])
def test_holes_are_filled_from_within_the_range_and_the_rest_stays(shape, share):
    image = holed(shape, share)
    found, known = filled(image), torch.isfinite(image)
    assert torch.equal(found[known], image[known]) and torch.isfinite(found).all()
    assert found.min() >= image[known].min() - 1e-6 and found.max() <= image[known].max() + 1e-6
    assert torch.equal(filled(found), found)


@over(shape=SHAPES, scale=SCALES)
def test_filling_commutes_with_scale_and_offset(shape, scale):
    image = holed(shape)
    torch.testing.assert_close(filled(scale * image + 3 * scale), scale * filled(image) + 3 * scale, rtol=1e-5, atol=0)


@pytest.mark.parametrize("size", [8, 16, 32])
def test_filling_commutes_with_the_symmetries_of_a_square(size):
    image = holed((size, size), 0.8)
    torch.testing.assert_close(filled(image.T), filled(image).T)
    torch.testing.assert_close(filled(image.flip(0)), filled(image).flip(0))
    torch.testing.assert_close(filled(image.rot90()), filled(image).rot90())


KINDS = ("affine", "inverse")


def pair(kind: str, k=0.7, b=0.4, seed=0) -> tuple[torch.Tensor, torch.Tensor]:
    """Stored depth and the true one that it stands for."""
    stored = 0.2 + 2 * torch.rand(600, generator=torch.Generator().manual_seed(seed))
    line = k * stored + b
    return stored, 1 / line if kind == "inverse" else line


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("k", "b"), [(0.7, 0.4), (3.0, 0.05), (0.05, 1.0)])
def test_fits_undo_themselves(kind, k, b):
    stored, depth = pair(kind, k, b)
    line = align(stored, depth, kind)
    torch.testing.assert_close(line, torch.tensor([k, b]), rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(aligned_depth(stored[None], line, kind)[0], depth, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("noise", [0.0, 0.02])
@over(scale=SCALES)
def test_the_unit_of_depth_scales_the_line(kind, noise, scale):
    stored, depth = pair(kind)
    depth = depth * (1 + noise * torch.randn(600, generator=torch.Generator().manual_seed(1)))
    here, there = align(stored, depth, kind), align(stored, scale * depth, kind)
    factor = 1 / scale if kind == "inverse" else scale
    torch.testing.assert_close(there, factor * here, rtol=2e-3, atol=1e-6 * factor)


@pytest.mark.parametrize("kind", KINDS)
def test_an_offset_of_what_is_stored_moves_the_offset_alone(kind):
    stored, depth = pair(kind)
    here, there = align(stored, depth, kind), align(stored + 5, depth, kind)
    torch.testing.assert_close(there[0], here[0], rtol=1e-4, atol=0)
    torch.testing.assert_close(there[1], here[1] - 5 * here[0], rtol=0, atol=2e-3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_samples_says_nothing(kind, seed):
    stored, depth = pair(kind)
    noisy = depth * (1 + 0.05 * torch.randn(600, generator=torch.Generator().manual_seed(seed)))
    order = torch.randperm(600, generator=torch.Generator().manual_seed(seed + 10))
    torch.testing.assert_close(
        align(stored[order], noisy[order], kind), align(stored, noisy, kind), rtol=1e-4, atol=1e-5
    )


def test_samples_that_are_none_do_not_count():
    stored, depth = pair("affine")
    more = torch.cat([stored, torch.tensor([float("nan"), 1.0, 1.0, 9.0])])
    known = torch.cat([depth, torch.tensor([1.0, float("inf"), -2.0, 0.0])])
    torch.testing.assert_close(align(more, known, "affine"), align(stored, depth, "affine"))
    assert align(stored[:23], depth[:23], "affine") is None
    assert align(stored, torch.full_like(depth, 2.0), "affine") is None
    assert align(stored, 4 - depth, "affine") is None  # the other way round: no network means that


@pytest.mark.parametrize("value", [0.0, 0.25, -3.0])
def test_even_fields_stay_even(value):
    even = torch.full((48, 36), value)
    means = cell_means(even)
    assert means.shape == (CELLS, CELLS)
    torch.testing.assert_close(means[2:-2, 2:-2], torch.full((CELLS - 4,) * 2, value))
    torch.testing.assert_close(spread(torch.full((CELLS, CELLS), value), 20, 30), torch.full((20, 30), value))


@pytest.mark.parametrize("error", [0.0, 0.03, -0.05])
def test_an_even_error_is_found_everywhere_it_can_be(error):
    aligned = 1 + torch.rand(60, 48, generator=torch.Generator().manual_seed(2))
    known = aligned * (1 + error)
    field = slow_errors(known, aligned)
    assert (field[2:-2, 2:-2] - error).abs().max() < 0.06 * abs(error) + 1e-6
    known[:, :24] = torch.nan
    assert slow_errors(known, aligned)[:, :3].abs().max() < abs(error) + 1e-6
    assert not slow_errors(torch.full_like(known, torch.nan), aligned).any()
