"""Relocation keeps what a splat looks like; noise leaves opaque splats alone."""

import math

import pytest
import torch

from goc.reconstruct.mcmc import copy_values, drawn_by_opacity, exploration_noise


def double_sum(opacity: float, copies: int) -> float:
    """S by Eq. (9) of Kheradmand et al.: Σ_{i=1…n} Σ_{k=0…i-1} C(i-1, k) (-1)^k o'^(k+1) / √(k+1)."""
    new = 1 - (1 - opacity) ** (1 / copies)
    return sum(
        math.comb(i - 1, k) * (-1) ** k * new ** (k + 1) / math.sqrt(k + 1)
        for i in range(1, copies + 1)
        for k in range(i)
    )


@pytest.mark.parametrize("copies", [1, 2, 5, 20])
@pytest.mark.parametrize("opacity", [0.05, 0.5, 0.95])
def test_copies_match_the_papers_double_sum(copies, opacity):
    opacities, scales = copy_values(torch.tensor([opacity]), torch.full((1, 3), 0.2), torch.tensor([copies]))
    assert opacities.item() == pytest.approx(1 - (1 - opacity) ** (1 / copies), rel=1e-5)
    assert scales[0, 0].item() == pytest.approx(0.2 * opacity / double_sum(opacity, copies), rel=1e-4)


def test_one_copy_changes_nothing():
    opacities, scales = copy_values(torch.tensor([0.3, 0.9]), torch.full((2, 3), 0.1), torch.ones(2, dtype=torch.int64))
    assert torch.allclose(opacities, torch.tensor([0.3, 0.9]))
    assert torch.allclose(scales, torch.full((2, 3), 0.1))


def test_copies_together_have_the_opacity_of_the_one():
    opacities, _ = copy_values(torch.tensor([0.8]), torch.ones(1, 3), torch.tensor([4]))
    assert 1 - (1 - opacities.item()) ** 4 == pytest.approx(0.8, rel=1e-5)


def test_draw_follows_opacity():
    drawn = drawn_by_opacity(torch.tensor([0.0, 0.1, 0.9]), 10_000, torch.Generator().manual_seed(0))
    assert (drawn == 0).sum() == 0
    assert (drawn == 2).float().mean().item() == pytest.approx(0.9, abs=0.02)


def test_exploration_moves_transparent_splats_along_their_shape():
    log_scales = torch.tensor([[0.0, -4.0, -4.0]]).expand(5000, 3)
    quats = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).expand(5000, 4)
    generator = torch.Generator().manual_seed(0)
    still = exploration_noise(log_scales, quats, torch.full((5000,), 0.5), 1.0, generator)
    moved = exploration_noise(log_scales, quats, torch.zeros(5000), 1.0, generator)
    assert still.abs().max() < 1e-12
    gate = torch.sigmoid(torch.tensor(0.5)).item()
    assert moved[:, 0].std().item() == pytest.approx(gate, rel=0.05)
    assert moved[:, 1].std().item() == pytest.approx(gate * math.exp(-8), rel=0.05)
