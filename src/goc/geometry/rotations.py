"""Rotations as quaternions (wxyz) and matrices."""

import torch
from jaxtyping import Float
from torch import Tensor


def matrices_of_quats(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Rotation matrices of quaternions wxyz of any non-zero length; differentiable."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    entries = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return torch.stack(entries, -1).reshape(-1, 3, 3)


def rotated(quats: Float[Tensor, "n 4"], vectors: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
    """Each vector turned by its quaternion (wxyz, any non-zero length); differentiable, cheaper than the matrices."""
    unit = torch.nn.functional.normalize(quats, dim=-1)
    w, axis = unit[:, :1], unit[:, 1:]
    twice = 2.0 * torch.cross(axis, vectors, dim=-1)
    return vectors + w * twice + torch.cross(axis, twice, dim=-1)


def quats_towards(directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 4"]:
    """Unit quaternions wxyz of the shortest rotations that turn +z to the given unit directions."""
    x, y, z = directions.unbind(-1)
    quats = torch.stack([1.0 + z, -y, x, torch.zeros_like(z)], -1)
    flipped = torch.tensor([0.0, 1.0, 0.0, 0.0]).expand_as(quats)
    quats = torch.where((z < -0.999999)[:, None], flipped, quats)
    return torch.nn.functional.normalize(quats, dim=-1)
