"""Spherical harmonics: laws that fix them, band by band, over directions and rotations of every kind."""

import pytest
import torch

from goc.geometry.harmonics import BAND_0, colours_towards, harmonics
from goc.geometry.rotations import matrices_of_quats
from laws import DIRECTIONS, DTYPES, ROTATIONS, SCALES, close, only, over

BANDS = {degree: slice(degree**2, (degree + 1) ** 2) for degree in range(4)}


def some(count: int, seed=0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=-1)


@over(directions=DIRECTIONS, dtype=DTYPES)
def test_the_constant_is_constant_and_bands_nest(directions, dtype):
    whole = harmonics(directions.to(dtype), 3)
    assert whole.shape == (len(directions), 16) and whole.dtype == dtype
    close(whole[:, 0], torch.full((len(directions),), BAND_0, dtype=dtype))
    for degree in range(3):
        assert torch.equal(harmonics(directions.to(dtype), degree), whole[:, : (degree + 1) ** 2])


@over(directions=DIRECTIONS, dtype=DTYPES)
def test_squares_of_a_band_add_up_to_the_same_everywhere(directions, dtype):
    """Unsöld's theorem: Σ_m Y_lm² = (2l + 1) / 4π."""
    basis = harmonics(directions.to(dtype), 3)
    for degree, band in BANDS.items():
        expected = torch.full((len(directions),), (2 * degree + 1) / (4 * torch.pi), dtype=dtype)
        close(basis[:, band].square().sum(-1), expected, ulps=32)


@over(directions=DIRECTIONS)
def test_odd_bands_change_sign_on_the_other_side(directions):
    here, there = harmonics(directions, 3), harmonics(-directions, 3)
    for degree, band in BANDS.items():
        close(there[:, band], (-1) ** degree * here[:, band])


@over(quats=only(ROTATIONS, "near identity", "quarter turns", "half turns", "nearly half turns", "any"))
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_turned_harmonics_stay_in_their_band(quats, degree):
    """Y(R d) = D(R) Y(d) with one orthogonal matrix D for all directions."""
    band, fitted, others = BANDS[degree], some(40), some(30, 1)
    for matrix in matrices_of_quats(quats)[:4]:
        before, after = harmonics(fitted, 3)[:, band], harmonics(fitted @ matrix.T, 3)[:, band]
        turn = torch.linalg.lstsq(before, after).solution
        close(harmonics(others, 3)[:, band] @ turn, harmonics(others @ matrix.T, 3)[:, band], ulps=256)
        close(turn @ turn.T, torch.eye(2 * degree + 1, dtype=torch.float64), ulps=256)


@over(scale=SCALES, dtype=DTYPES)
def test_colours_depend_on_the_direction_alone(scale, dtype):
    generator = torch.Generator().manual_seed(2)
    sh = 0.2 * torch.randn(20, 16, 3, generator=generator, dtype=dtype)
    directions, eye = some(20, 3).to(dtype), torch.zeros(3, dtype=dtype)
    near = colours_towards(sh, directions, eye)
    close(colours_towards(sh, scale * directions, eye), near, ulps=64)
    assert (near >= 0).all() and (near > 0).any()
    expected = 0.5 + torch.einsum("nk,nkc->nc", harmonics(directions, 3), sh)
    close(near, expected.clamp_min(0), ulps=64)


def test_no_gradient_reaches_the_means_and_all_reaches_the_coefficients():
    means, sh = some(5).requires_grad_(), torch.zeros(5, 4, 3, dtype=torch.float64).requires_grad_()
    colours_towards(sh, means, torch.zeros(3, dtype=torch.float64)).sum().backward()
    assert means.grad is None
    close(sh.grad[..., 0], harmonics(means.detach(), 1))
