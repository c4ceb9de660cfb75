"""Spherical harmonics: orthonormal, and in the convention of 3DGS files."""

import pytest
import torch

from goc.geometry.harmonics import BAND_0, colours_towards, harmonics
from goc.geometry.rotations import matrices_of_quats, quats_towards, rotated


def directions(count: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_harmonics_are_orthonormal(degree):
    basis = harmonics(directions(200_000), degree).double()
    gram = 4 * torch.pi * basis.T @ basis / len(basis)
    assert torch.allclose(gram, torch.eye((degree + 1) ** 2, dtype=torch.float64), atol=0.03)


def test_first_band_has_the_order_and_signs_of_3dgs_files():
    axes = torch.eye(3)
    basis = harmonics(axes, 1)
    assert torch.allclose(basis[:, 0], torch.full((3,), BAND_0))
    c = 0.4886025
    assert torch.allclose(basis[:, 1:], torch.tensor([[0, 0, -c], [-c, 0, 0], [0, c, 0.0]]), atol=1e-6)


def test_colour_of_the_constant_band_and_its_floor():
    sh = torch.zeros(2, 4, 3)
    sh[0, 0], sh[1, 0] = 1.0, -9.0
    colours = colours_towards(sh, torch.randn(2, 3), torch.zeros(3))
    assert torch.allclose(colours[0], torch.full((3,), 0.5 + BAND_0))
    assert not colours[1].any()
    assert torch.allclose(colours_towards(sh[:, :1], torch.randn(2, 3), torch.zeros(3)), colours)


def test_quats_towards_turn_z_to_the_direction():
    wanted = torch.cat([directions(50), torch.tensor([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])])
    turned = matrices_of_quats(quats_towards(wanted))[:, :, 2]
    assert torch.allclose(turned, wanted, atol=1e-5)


def test_matrices_of_quats_are_rotations_whatever_the_length():
    quats = torch.randn(20, 4)
    matrices = matrices_of_quats(quats)
    assert torch.allclose(matrices @ matrices.transpose(1, 2), torch.eye(3).expand(20, 3, 3), atol=1e-5)
    assert torch.allclose(torch.linalg.det(matrices), torch.ones(20), atol=1e-5)
    assert torch.allclose(matrices_of_quats(3.0 * quats), matrices, atol=1e-5)


def test_rotated_vectors_match_the_matrices():
    generator = torch.Generator().manual_seed(0)
    quats, vectors = torch.randn(30, 4, generator=generator), torch.randn(30, 3, generator=generator)
    expected = torch.einsum("nij,nj->ni", matrices_of_quats(quats), vectors)
    assert torch.allclose(rotated(quats, vectors), expected, atol=1e-5)
