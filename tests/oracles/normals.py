"""Plane fits to windows of a depth image, pixel by pixel, float64 least squares in space."""

import numpy as np


def fitted_normal(points: np.ndarray, x: int, y: int, radius: int, agree: float) -> np.ndarray | None:
    """Normal at (x, y) of inverse depth fitted over the window; points (h w 3) in camera axes, NaN = none."""
    rows, columns, _ = points.shape
    z = points[y, x, 2]
    window = points[max(0, y - radius) : min(rows, y + radius + 1), max(0, x - radius) : min(columns, x + radius + 1)]
    near = window[np.abs(window[..., 2] - z) <= agree * z]
    if not z > 0 or len(near) < (2 * radius + 1) ** 2 // 2 + 1:
        return None
    rays = near / near[:, 2:]  # (u, v, 1): 1/z = A·u + B·v + C
    plane, *_ = np.linalg.lstsq(rays, 1.0 / near[:, 2], rcond=None)
    return -plane / np.linalg.norm(plane)
