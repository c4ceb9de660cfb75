"""Rotations: what holds for quaternions of every kind, in both precisions."""

import pytest
import torch

from goc.geometry.rotations import matrices_of_quats, quats_towards, rotated
from laws import DIRECTIONS, DTYPES, ROTATIONS, close, only, over


def product(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Hamilton's product of quaternions wxyz."""
    (w, v), (x, u) = ((q[:, :1], q[:, 1:]) for q in (a, b))
    return torch.cat([w * x - (v * u).sum(-1, keepdim=True), w * u + x * v + torch.linalg.cross(v, u)], -1)


def unit(quats: torch.Tensor) -> torch.Tensor:
    return torch.nn.functional.normalize(quats, dim=-1)


@over(quats=ROTATIONS, dtype=DTYPES)
def test_matrices_are_orthonormal_and_right_handed(quats, dtype):
    matrices = matrices_of_quats(quats.to(dtype))
    assert matrices.shape == (len(quats), 3, 3) and matrices.dtype == dtype
    close(matrices @ matrices.transpose(1, 2), torch.eye(3, dtype=dtype).expand(len(quats), 3, 3))
    close(torch.linalg.det(matrices), torch.ones(len(quats), dtype=dtype))


@over(quats=ROTATIONS, dtype=DTYPES)
def test_quaternions_cover_rotations_twice_and_their_length_says_nothing(quats, dtype):
    matrices = matrices_of_quats(quats.to(dtype))
    close(matrices_of_quats(-quats.to(dtype)), matrices)
    close(matrices_of_quats(7.0 * quats.to(dtype)), matrices)


@over(quats=ROTATIONS, dtype=DTYPES)
def test_the_conjugate_turns_back(quats, dtype):
    back = quats * torch.tensor([1.0, -1.0, -1.0, -1.0], dtype=torch.float64)
    close(matrices_of_quats(back.to(dtype)), matrices_of_quats(quats.to(dtype)).transpose(1, 2))


@over(first=ROTATIONS, second=only(ROTATIONS, "next to identity", "half turns", "any", "short"))
def test_products_of_quaternions_are_products_of_matrices(first, second):
    a, b = unit(first.repeat_interleave(len(second), 0)), unit(second.repeat(len(first), 1))
    close(matrices_of_quats(product(a, b)), matrices_of_quats(a) @ matrices_of_quats(b))


@over(quats=ROTATIONS, dtype=DTYPES)
def test_turning_a_vector_is_multiplying_by_the_matrix(quats, dtype):
    vectors = torch.randn(len(quats), 3, dtype=dtype, generator=torch.Generator().manual_seed(0))
    expected = torch.einsum("nij,nj->ni", matrices_of_quats(quats.to(dtype)), vectors)
    close(rotated(quats.to(dtype), vectors), expected, size=4.0)
    close(rotated(quats.to(dtype), vectors).norm(dim=-1), vectors.norm(dim=-1), size=4.0)


@over(quats=ROTATIONS)
def test_the_axis_stays_and_the_angle_is_that_of_the_trace(quats):
    q, matrices = unit(quats), matrices_of_quats(quats)
    close(torch.einsum("nij,nj->ni", matrices, q[:, 1:]), q[:, 1:])
    close(torch.einsum("nii->n", matrices), 4 * q[:, 0].square() - 1)


@over(directions=DIRECTIONS, dtype=DTYPES)
def test_shortest_rotations_from_z_arrive_and_do_not_roll(directions, dtype):
    quats = quats_towards(directions.to(dtype))
    assert quats.dtype == dtype
    close(quats.norm(dim=-1), torch.ones(len(quats), dtype=dtype))
    close(matrices_of_quats(quats)[:, :, 2], directions.to(dtype), ulps=64)
    close(quats[:, 3], torch.zeros(len(quats), dtype=dtype))  # the axis lies across z
    cosine = 2 * quats[:, 0].square() - 1
    close(cosine, directions[:, 2].to(dtype), ulps=64)


@over(quats=only(ROTATIONS, "near identity", "half turns", "any"))
@pytest.mark.parametrize("function", ["matrices", "rotated"])
def test_gradients_are_those_of_finite_differences(quats, function):
    few = quats[:3].clone().requires_grad_()
    vectors = torch.randn(len(few), 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    turn = matrices_of_quats if function == "matrices" else lambda q: rotated(q, vectors)
    assert torch.autograd.gradcheck(turn, (few,))
