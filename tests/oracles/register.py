"""Registration of a view against another, straight from its definition: the twin of native/register.cpp."""

import numpy as np


def matches(samples, grey, world_from_own, view, world_from_view, shade, limits):
    """Points that both views show: gap residuals, their levers and weights; grey of both, the target's levers."""
    noise, square, reach, cosine = limits
    cam = np.linalg.inv(world_from_view) @ world_from_own
    points = samples.points.astype(float) @ cam[:3, :3].T + cam[:3, 3]
    normals = samples.normals.astype(float) @ cam[:3, :3].T
    focal, centre = view.camera.focal_px.numpy(), view.camera.centre_px.numpy()
    gaps, greys = [], []
    for point, normal, own in zip(points, normals, grey, strict=True):
        u, v = point[:2] / point[2] * focal + centre - 0.5
        if point[2] <= 1e-6 or not (0 <= u < view.camera.width - 1 and 0 <= v < view.camera.height - 1):
            continue
        row, column = int(v + 0.5), int(u + 0.5)
        z, facing = float(view.depth[row, column]), view.normals[row, column].astype(float)
        if not (np.isfinite(z) and normal @ facing >= cosine):
            continue
        surface = np.append((np.array([column, row]) + 0.5 - centre) / focal * z, z)
        gap = (point - surface) @ facing
        if abs(gap) > reach:
            continue
        sigma = noise + square * point[2] ** 2
        gaps.append((gap, np.append(np.cross(point, facing), facing), 1 / (1 + (2 * gap / reach) ** 2) ** 2 / sigma**2))
        x, y = int(u), int(v)
        s, t = u - x, v - y
        (a, b), (c, d) = shade[y : y + 2, x : x + 2].astype(float)
        seen = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d)
        slope = np.array([(1 - t) * (b - a) + t * (d - c), (1 - s) * (c - a) + s * (d - b)])
        if min(own, seen) < 0.02 or max(own, seen) > 0.97:
            continue
        along = slope * focal / point[2]
        change = np.append(along, -(along @ point[:2]) / point[2])
        greys.append((own, seen, np.append(np.cross(point, change), change)))
    return gaps, greys


def sums(rows):
    """Σ w a aᵀ, Σ w a r, how many, Σ|r|."""
    residuals, levers, weights = (np.array(part) for part in zip(*rows, strict=True))
    matrix = np.einsum("pa,p,pb->ab", levers, weights, levers)
    vector = np.einsum("pa,p->a", levers, weights * residuals)
    return np.concatenate([matrix.reshape(-1), vector, [len(residuals), np.abs(residuals).sum()]])
