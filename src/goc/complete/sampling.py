"""Farthest point sampling."""

import torch
from jaxtyping import Float, Int64
from torch import Tensor


def farthest_points(points: Float[Tensor, "b p 3"], count: int) -> Int64[Tensor, "b {count}"]:
    """FPS (Qi et al. 2017): starts at the first point, then always takes the point farthest from those taken.

    Where there are fewer distinct points than asked for, some repeat. Of equally far points the first is taken.

    Args:
        points: any frame and unit.
        count: how many rows to take of each cloud.
    """
    batch = torch.arange(points.shape[0], device=points.device)
    taken = torch.zeros(points.shape[0], count, dtype=torch.int64, device=points.device)
    distance = torch.full(points.shape[:2], torch.inf, dtype=points.dtype, device=points.device)
    for place in range(1, count):
        last = points[batch, taken[:, place - 1]]
        distance = torch.minimum(distance, (points - last[:, None]).square().sum(-1))
        taken[:, place] = distance.argmax(-1)
    return taken
