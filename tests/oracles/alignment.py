"""Slow, obvious twin of the robust line fit: try the line through every pair of samples."""

import numpy as np


def best_line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Least squares of y = k x + b, by relative errors, over the inliers of the pair's line with least median error."""
    first, second = np.triu_indices(len(x), 1)
    slope = (y[second] - y[first]) / (x[second] - x[first])
    offset = y[first] - slope * x[first]
    errors = np.abs((slope[:, None] * x + offset[:, None]) / y - 1.0)
    medians = np.median(errors, axis=1)
    best = np.argmin(medians)
    inside = errors[best] < 5.0 * 1.4826 * medians[best] + 1e-6
    k, b = np.polyfit(x[inside], y[inside], 1, w=1.0 / y[inside])
    return float(k), float(b)
