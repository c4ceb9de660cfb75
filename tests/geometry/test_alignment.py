"""k and b of monocular depth: exact where it is, near the truth where a third of what it is told is wrong."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from goc.geometry.alignment import CELLS, align, aligned_depth, slow_errors, spread
from oracles.alignment import best_line


def samples(count: int = 400, seed: int = 0) -> torch.Tensor:
    return 0.5 + 3.0 * torch.rand(count, generator=torch.Generator().manual_seed(seed))


@settings(max_examples=25)
@given(k=st.floats(0.1, 10.0), b=st.floats(-0.04, 2.0), kind=st.sampled_from(["affine", "inverse"]))
def test_exact_depth_gives_back_scale_and_offset(k, b, kind):
    stored = samples()
    depth = aligned_depth(stored[None], torch.tensor([k, b]), kind)[0]
    torch.testing.assert_close(align(stored, depth, kind), torch.tensor([k, b]), rtol=1e-3, atol=1e-3)


def test_inverse_is_the_law_of_its_reciprocal():
    stored, line = samples(), torch.tensor([0.7, 0.2])
    product = aligned_depth(stored[None], line, "inverse") * aligned_depth(stored[None], line, "affine")
    torch.testing.assert_close(product, torch.ones_like(product))


@pytest.mark.parametrize("kind", ["affine", "inverse"])
@pytest.mark.parametrize(
    "spoil",
    [
        lambda z, wild: z + 3.0,
        lambda z, wild: 0.1 + 8.0 * wild,
        lambda z, wild: torch.full_like(z, 0.4),
        lambda z, wild: torch.full_like(z, torch.nan),
    ],
    ids=["behind", "anywhere", "one-depth", "missing"],
)
def test_thirty_percent_of_outliers_do_not_matter(kind, spoil):
    stored = samples(3000)
    depth = aligned_depth(stored[None], torch.tensor([0.6, 0.3]), kind)[0]
    wild = torch.rand(3000, generator=torch.Generator().manual_seed(1))
    bad = torch.rand(3000, generator=torch.Generator().manual_seed(2)) < 0.3
    found = align(stored, torch.where(bad, spoil(depth, wild), depth), kind)
    torch.testing.assert_close(found, torch.tensor([0.6, 0.3]), atol=2e-3, rtol=0)


def test_noise_averages_out():
    stored = samples(2000)
    noise = torch.randn(2000, generator=torch.Generator().manual_seed(3))
    depth = (1.4 * stored - 0.2) * (1.0 + 0.05 * noise)
    found = align(stored, depth, "affine")
    # σ of k is about 0.05 · z / √p / σ(x): 0.003; four of those.
    torch.testing.assert_close(found, torch.tensor([1.4, -0.2]), atol=0.015, rtol=0)


@pytest.mark.parametrize("seed", range(4))
def test_it_finds_what_trying_every_pair_finds(seed):
    random = np.random.default_rng(seed)
    x = random.uniform(0.5, 3.0, 120)
    y = (0.8 * x + 0.5) * (1 + 0.01 * random.normal(size=120))
    bad = random.random(120) < 0.3
    y[bad] = random.uniform(0.2, 8.0, bad.sum())
    found = align(torch.from_numpy(x).float(), torch.from_numpy(y).float(), "affine")
    # Both keep all good samples but for those at the threshold: half a standard error (0.01 · 2 / √84 / 0.7 = 0.003).
    np.testing.assert_allclose(found, best_line(x, y), atol=0.004)


def test_samples_without_trust_do_not_count():
    stored = samples()
    depth = 2.0 * stored + 0.1
    depth[:200] = 2.0 * depth[:200]
    weights = (torch.arange(400) >= 200).float()
    torch.testing.assert_close(align(stored, depth, "affine", weights), torch.tensor([2.0, 0.1]), rtol=1e-4, atol=1e-4)


def test_the_unit_of_either_side_only_scales_the_answer():
    stored = samples()
    depth = (1.3 * stored + 0.4) * (1 + 0.02 * torch.randn(400, generator=torch.Generator().manual_seed(4)))
    k, b = align(stored, depth, "affine").tolist()
    assert align(stored, 1000.0 * depth, "affine").tolist() == pytest.approx([1000 * k, 1000 * b], rel=1e-4)
    assert align(1000.0 * stored, depth, "affine").tolist() == pytest.approx([k / 1000, b], rel=1e-4)


@pytest.mark.parametrize(
    ("stored", "depth"),
    [
        (samples(10), samples(10)),
        (samples(), torch.full((400,), torch.nan)),
        (torch.zeros(0), torch.zeros(0)),
        (samples(), torch.full((400,), 2.0)),
        (torch.full((400,), 2.0), samples()),
        (samples(), 5.0 - samples()),
        (samples(), -samples()),
    ],
    ids=["few", "none", "empty", "wall", "flat", "mirrored", "behind"],
)
def test_what_tells_nothing_has_no_answer(stored, depth):
    assert align(stored, depth, "affine") is None
    assert align(stored, depth, "affine", torch.ones_like(stored)) is None


def test_depth_that_is_not_before_the_camera_is_none():
    stored = torch.tensor([[1.0, 0.1, torch.nan]])
    found = aligned_depth(stored, torch.tensor([1.0, -0.5]), "affine")
    torch.testing.assert_close(found, torch.tensor([[0.5, torch.nan, torch.nan]]), equal_nan=True)
    found = aligned_depth(stored, torch.tensor([1.0, -0.5]), "inverse")
    torch.testing.assert_close(found, torch.tensor([[2.0, torch.nan, torch.nan]]), equal_nan=True)


def wave(rows: int, columns: int, size: float = 0.03) -> torch.Tensor:
    """An error that changes once along each side."""
    y, x = torch.meshgrid(torch.linspace(0, 1, rows), torch.linspace(0, 1, columns), indexing="ij")
    return size * torch.cos(2.0 * x + 1.0) * torch.cos(2.5 * y)


@pytest.mark.parametrize("shape", [(48, 64), (96, 120)])
def test_slow_errors_are_found_and_sharp_ones_are_not(shape):
    aligned = 2.0 + torch.rand(shape, generator=torch.Generator().manual_seed(5))
    known = aligned * (1.0 + wave(*shape))
    wild = torch.rand(shape, generator=torch.Generator().manual_seed(6))
    known = torch.where(wild < 0.2, 5.0 * wild, known)
    known = torch.where(wild > 0.6, torch.nan, known)
    left = (spread(slow_errors(known, aligned), *shape) - wave(*shape)).abs()
    # The blur flattens a wave of curvature 2.5² · 0.03 by half of that times its own 0.007; the ridge takes a tenth.
    assert left.median() < 0.004 and left.max() < 0.015


def test_where_nothing_is_known_nothing_is_bent():
    aligned = torch.full((48, 64), 2.0)
    assert torch.equal(slow_errors(torch.full_like(aligned, torch.nan), aligned), torch.zeros(CELLS, CELLS))
    half = torch.where(torch.arange(64) < 32, 1.05 * aligned, torch.nan)
    field = slow_errors(half, aligned)
    assert field[:, :5].mean() == pytest.approx(0.05, abs=0.008)
    assert field[:, 9:].abs().max() == 0.0
