"""What OSC-lite is told beside its evidence: the evidence mirrored in the planes that were found, and the convex hull.

Neither is true everywhere. A network that meets both in training learns where to believe them.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Float32
from scipy.spatial import ConvexHull, QhullError
from torch.nn import functional

from goc.complete.mirrors import MirrorPlane, mirror_planes, surface_points
from goc.scene import EvidenceGrid

HINTS = ("mirrored distance", "mirrored surface", "mirrored empty", "hull")
"""Distance, surface and empty as mirrored in up to two planes, times their score; depth below the convex hull of the
measured surface, positive inside."""

_DEPTH = 0.25
"""Depth below the hull at which its channel saturates, model units."""


def hint_channels(
    evidence: EvidenceGrid, seen: Float32[np.ndarray, "c n n n"]
) -> Float32[np.ndarray, "4 {seen.shape[1]} {seen.shape[1]} {seen.shape[1]}"]:
    """HINTS on the grid of a network.

    Args:
        evidence: in model units.
        seen: distance, surface and empty of the evidence on that grid, then others.

    Returns:
        [-1, 1]; 0 where there is no plane, or nothing was measured.
    """
    points, normals = surface_points(evidence)
    mirrored = _mirrored(seen[:3], mirror_planes(points, normals, evidence))
    return np.concatenate([mirrored, _below_hull(points, seen.shape[-1])[None]])


def _mirrored(
    seen: Float32[np.ndarray, "3 n n n"], planes: Sequence[MirrorPlane]
) -> Float32[np.ndarray, "3 {seen.shape[1]} {seen.shape[1]} {seen.shape[1]}"]:
    """What lies at the mirror images of the cells; the second plane tells what the first leaves open."""
    cells = seen.shape[-1]
    axis = (torch.arange(cells, dtype=torch.float64) + 0.5) * (2.0 / cells) - 1.0
    centres = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3).numpy()
    volume, told = torch.from_numpy(seen)[None], torch.zeros(seen.shape)
    for plane in planes:
        images = torch.from_numpy(plane.image(centres).astype(np.float32)).flip(-1)
        found = functional.grid_sample(volume, images.reshape(1, cells, cells, cells, 3), align_corners=False)[0]
        told = told + plane.score * (1.0 - told[1] - told[2]).clamp_min(0.0) * found
    return told.numpy()


def _below_hull(points: Float[np.ndarray, "p 3"], cells: int) -> Float32[np.ndarray, "{cells} {cells} {cells}"]:
    """Depth below the convex hull, from a grid of half as many cells: it is smooth."""
    coarse = max(1, cells // 2)
    axis = ((np.arange(coarse) + 0.5) * (2.0 / coarse) - 1.0).astype(np.float32)
    centres = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    try:
        planes = np.unique(ConvexHull(points).equations.astype(np.float32).round(3), axis=0)
    except (QhullError, ValueError):  # flat, or no points
        return np.zeros((cells,) * 3, np.float32)
    depth = -(centres @ planes[:, :3].T + planes[:, 3]).max(axis=1) / _DEPTH
    grid = torch.from_numpy(np.clip(depth, -1, 1).reshape(1, 1, coarse, coarse, coarse))
    return functional.interpolate(grid, size=(cells,) * 3, mode="trilinear", align_corners=False)[0, 0].numpy()
