"""Which views see the same surface from elsewhere, judged by their poses alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from goc.scene.camera import Camera

_GRID = 6
"""Rays across and down of a view, whose overlap with another is counted."""


@dataclass(frozen=True, kw_only=True)
class PairLimits:
    """When two views make a pair. Lengths in scene units."""

    max_angle_deg: float
    """Between the viewing directions."""
    min_baseline: float
    """Between the camera positions: less gives no parallax."""
    max_baseline: float
    depths: tuple[float, ...]
    """Where surface is expected, z: there the frusta must overlap."""
    min_overlap: float = 0.3
    """Share of a view's frustum at those depths that the other one must see."""


def neighbour_views(
    cameras: Sequence[Camera], views: Sequence[int], count: int, limits: PairLimits
) -> dict[int, tuple[int, ...]]:
    """Up to `count` neighbours of each view among the same views, the most alike in direction first.

    Ties are broken by baseline and then by index, so that the same poses always give the same pairs. Being a
    neighbour is not mutual: only the view's own frustum must be seen, and only the first `count` are kept.

    Args:
        cameras: of all views.
        views: indices of those that take part.
        count: most neighbours of a view.
        limits: what makes a pair.

    Returns:
        Neighbours of each of `views`, by index into `cameras`; an empty tuple where there are none.
    """
    chosen = [cameras[view].double() for view in views]
    poses = np.stack([camera.world_from_cam.numpy() for camera in chosen])
    directions, positions = poses[:, :3, 2], poses[:, :3, 3]
    found: dict[int, tuple[int, ...]] = {}
    for row, view in enumerate(views):
        cosines = np.clip((directions * directions[row]).sum(-1), -1.0, 1.0)
        angles, baselines = np.degrees(np.arccos(cosines)), np.linalg.norm(positions - positions[row], axis=-1)
        near = (baselines >= limits.min_baseline) & (baselines <= limits.max_baseline)
        near &= angles <= limits.max_angle_deg
        near[row] = False
        # Rounded, so that the last bits of a pose do not decide.
        others: list[int] = np.flatnonzero(near).tolist()
        order = sorted(others, key=lambda i: (round(angles[i], 6), round(baselines[i], 9), views[i]))
        points = _frustum(chosen[row], limits.depths)
        kept: list[int] = []
        for other in order:
            if len(kept) == count:
                break
            if chosen[other].sees(points).double().mean() >= limits.min_overlap:
                kept.append(views[other])
        found[view] = tuple(kept)
    return found


def _frustum(camera: Camera, depths: tuple[float, ...]) -> Float64[Tensor, "p 3"]:
    """Points all over a view at the given depths, world."""
    steps = (torch.arange(_GRID, dtype=torch.float64) + 0.5) / _GRID
    places = torch.cartesian_prod(steps * camera.width, steps * camera.height, torch.tensor(depths, dtype=steps.dtype))
    return camera.unproject(places[:, :2], places[:, 2])
