"""Planes in point clouds: least squares, and seeded RANSAC from oriented points."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


def along(points: Float[np.ndarray, "p 3"], direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "p"]:
    """Dot products, summed in one order whatever the number of threads (a BLAS may not)."""
    return points[:, 0] * direction[0] + points[:, 1] * direction[1] + points[:, 2] * direction[2]


@dataclass(frozen=True, eq=False)
class Plane:
    """Points x with normal · x = offset; the normal is unit and tells the front."""

    normal: Float[np.ndarray, "3"]
    offset: float

    def distance(self, points: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p"]:
        """Signed distance, positive in front."""
        return along(points, self.normal) - self.offset


def fit_plane(points: Float[np.ndarray, "p 3"], towards: Float[np.ndarray, "3"]) -> Plane:
    """Least-squares plane (smallest principal axis), its normal turned to agree with `towards`.

    Raises:
        ValueError: fewer than three points.
    """
    if len(points) < 3:
        raise ValueError(f"a plane needs 3 points, not {len(points)}")
    centre = points.mean(0)
    centred = points - centre
    _, axes = np.linalg.eigh(np.einsum("pi,pj->ij", centred, centred))
    normal = axes[:, 0] if axes[:, 0] @ towards >= 0 else -axes[:, 0]
    return Plane(normal, float(normal @ centre))


def plane_inliers(
    plane: Plane,
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    tolerance: float,
    cosine: float = 0.8,
) -> Bool[np.ndarray, "p"]:
    """Points within `tolerance` of the plane whose normals agree with its own to `cosine` or better."""
    return (np.abs(plane.distance(points)) <= tolerance) & (along(normals, plane.normal) >= cosine)


def refine_plane(
    plane: Plane, points: Float[np.ndarray, "p 3"], normals: Float[np.ndarray, "p 3"], tolerance: float, rounds: int = 3
) -> Plane:
    """Least squares on the inliers, repeated; the plane itself where fewer than three points agree."""
    for _ in range(rounds):
        chosen = plane_inliers(plane, points, normals, tolerance)
        if chosen.sum() < 3:
            break
        plane = fit_plane(points[chosen], plane.normal)
    return plane


def find_plane(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    tolerance: float,
    rng: np.random.Generator,
    trials: int = 200,
    sample: int = 8192,
) -> Plane | None:
    """The plane with most inliers: RANSAC (Fischler and Bolles 1981) over oriented points, then least squares.

    A point and its normal are one hypothesis, so 200 of them meet a plane that holds 3 % of the points with
    probability 0.998. Hypotheses are scored on at most `sample` points.
    """
    if len(points) < 3:
        return None
    judges = np.sort(rng.choice(len(points), min(sample, len(points)), replace=False))
    seen_points, seen_normals = points[judges], normals[judges]
    seeds = rng.choice(len(points), trials)
    best, best_count = None, 2
    for seed in seeds:
        plane = Plane(normals[seed], float(normals[seed] @ points[seed]))
        count = int(plane_inliers(plane, seen_points, seen_normals, tolerance).sum())
        if count > best_count:
            best, best_count = plane, count
    return None if best is None else refine_plane(best, points, normals, tolerance)


def robust_sigma(distances: Float[np.ndarray, "p"]) -> float:
    """Robust standard deviation of residuals about zero: 1.4826 × median absolute value; 0 for none."""
    return float(1.4826 * np.median(np.abs(distances))) if len(distances) else 0.0
