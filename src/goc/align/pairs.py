"""Which views are compared: those that see much of each other's surface."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64

from goc.align.images import AlignedView

_POINTS = 64
"""Points of a view by which its overlap with others is told."""
_TOLERANCE = 0.1
"""Depths within this share of each other may be of one surface: cameras are not known yet."""
_OVERLAP = 0.2
"""Share of a view's points that another has to see."""


def compared_views(
    views: Sequence[AlignedView | None], poses: Float64[np.ndarray, "v 4 4"], count: int, among: Bool[np.ndarray, "v"]
) -> list[list[int]]:
    """Up to `count` others that see a view's surface, from those that see most of it to those that just do.

    Neighbours alone would let errors grow along the path; views from elsewhere close the loops.

    Args:
        views: their coarse images; None takes no part.
        poses: world from camera.
        count: most others of a view.
        among: which views may be the others.
    """
    found: list[list[int]] = []
    for index, view in enumerate(views):
        if view is None:
            found.append([])
            continue
        points = _scattered(view) @ poses[index, :3, :3].T + poses[index, :3, 3]
        shares = np.array([_seen(points, other, pose) for other, pose in zip(views, poses, strict=True)])
        shares[index] = 0.0
        good = np.flatnonzero((shares > _OVERLAP) & among)
        ranked = good[np.lexsort((good, -shares[good]))]
        if len(ranked) > count:
            ranked = ranked[np.rint(np.linspace(0, len(ranked) - 1, count)).astype(int)]
        found.append([int(other) for other in ranked])
    return found


def _scattered(view: AlignedView) -> Float64[np.ndarray, "p 3"]:
    """Points all over a view, camera axes."""
    rows, columns = np.nonzero(np.isfinite(view.depth))
    chosen = np.linspace(0, len(rows) - 1, min(_POINTS, len(rows))).astype(int)
    rows, columns = rows[chosen], columns[chosen]
    z = view.depth[rows, columns].astype(np.float64)
    focal, centre = view.camera.focal_px.numpy(), view.camera.centre_px.numpy()
    return np.stack([(columns + 0.5 - centre[0]) / focal[0] * z, (rows + 0.5 - centre[1]) / focal[1] * z, z], -1)


def _seen(points: Float64[np.ndarray, "p 3"], view: AlignedView | None, pose: Float64[np.ndarray, "4 4"]) -> float:
    """Share of points whose depth a view confirms."""
    if view is None or len(points) == 0:
        return 0.0
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    z = np.where(local[:, 2] > 0, local[:, 2], np.nan)
    places = local[:, :2] / z[:, None] * view.camera.focal_px.numpy() + view.camera.centre_px.numpy()
    inside = ((places >= 0) & (places < [view.camera.width, view.camera.height])).all(-1)
    columns, rows = np.where(inside[:, None], places, 0).astype(int).T
    return float((inside & (np.abs(view.depth[rows, columns] - z) < _TOLERANCE * z)).mean())
