"""The eight symmetries that keep gravity and the grid: quarter turns about z, each with or without a mirror in x."""

import torch
from jaxtyping import Float
from torch import Tensor

POSES = 8


def posed_points(points: Float[Tensor, "*b 3"], pose: int) -> Float[Tensor, "*b 3"]:
    """Positions or directions in a pose, 0 … 7: mirrored in x from 4 on, then turned by quarters, (x, y) → (−y, x)."""
    x, y, z = points.unbind(-1)
    if pose >= POSES // 2:
        x = -x
    for _ in range(pose % 4):
        x, y = -y, x
    return torch.stack([x, y, z], -1)


def posed_volume(volume: Float[Tensor, "c n n n"], pose: int) -> Float[Tensor, "c n n n"]:
    """A field on a grid that fills the cube, in a pose: what was at x is at `posed_points(x)`."""
    if pose >= POSES // 2:
        volume = volume.flip(1)
    return torch.rot90(volume, pose % 4, (1, 2))
