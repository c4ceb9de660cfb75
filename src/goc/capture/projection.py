"""From directions to the plane of a lens, in closed form: the way a remap needs it."""

import math

import numpy as np
from jaxtyping import Float64

from goc.capture.lens import Lens

Rays = Float64[np.ndarray, "p 3"]
Plane = Float64[np.ndarray, "p 2"]
Numbers = Float64[np.ndarray, "p"]


def bend(lens: Lens, rays: Float64[np.ndarray, "*shape 3"]) -> Float64[np.ndarray, "*shape 2"]:
    """Where on the lens's plane directions are seen: times `focal_px`, plus `centre_px`, they are pixels.

    Args:
        lens: any; a turned one takes directions of the pinhole view.
        rays: in axes x right, y down, z forward, of any length but 0.

    Returns:
        NaN where the projection has no place, and beyond where distortion folds the image back.
    """
    rows = rays.reshape(-1, 3)
    if lens.turn is not None:
        rows = rows @ np.reshape(lens.turn, (3, 3)).T
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _distorted(lens, _projected(lens, rows)).reshape(*rays.shape[:-1], 2)


def _projected(lens: Lens, rays: Rays) -> Plane:
    x, y, z = rays.T
    if lens.projection == "equirectangular":
        return np.stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))], -1)
    rho = np.hypot(x, y)
    match lens.projection:
        case "perspective":
            stretch = 1 / np.where(z > 0, z, np.nan)
        case "fisheye":
            stretch = _ratio(np.arctan2(rho, z), rho, z)
        case "fov":
            gain = 2 * math.tan(lens.shape[0] / 2)
            angle = np.arctan2(gain * rho, z) / lens.shape[0]
            stretch = _ratio(angle, rho, z / gain * lens.shape[0])
        case "division":
            stretch = 2 / (z + np.sqrt(z * z - 4 * lens.shape[0] * rho * rho))
        case "eucm":
            alpha, beta = lens.shape
            stretch = 1 / (alpha * np.sqrt(beta * rho * rho + z * z) + (1 - alpha) * z)
    stretch = np.where(stretch > 0, stretch, np.nan)
    return np.stack([x * stretch, y * stretch], -1)


def _ratio(above: Numbers, rho: Numbers, on_axis: Numbers) -> Numbers:
    """The quotient above / rho, and its limit 1 / on_axis where rho is 0."""
    near = rho < 1e-12 * np.abs(on_axis)
    return np.where(near, 1 / on_axis, above / np.where(near, 1.0, rho))


def _distorted(lens: Lens, plane: Plane) -> Plane:
    shifted = any((*lens.tangential, *lens.prism))
    if not (any(lens.radial) or any(lens.denominator) or shifted):
        return plane
    square = (plane * plane).sum(-1)
    factor = _polynomial(lens.radial, square) / _polynomial(lens.denominator, square)
    stretched = plane * np.where(square < fold(lens), factor, np.nan)[..., None]
    return stretched + _shift(lens, stretched if lens.bent_twice else plane) if shifted else stretched


def _polynomial(coefficients: tuple[float, ...], square: Numbers) -> Numbers:
    value = np.zeros_like(square)
    for coefficient in reversed(coefficients):
        value = (value + coefficient) * square
    return 1 + value


def _shift(lens: Lens, plane: Plane) -> Plane:
    x, y = plane.T
    square = x * x + y * y
    p1, p2 = lens.tangential
    s1, s2, s3, s4 = lens.prism
    across = 2 * p1 * x * y + p2 * (square + 2 * x * x) + square * (s1 + s2 * square)
    down = p1 * (square + 2 * y * y) + 2 * p2 * x * y + square * (s3 + s4 * square)
    return np.stack([across, down], -1)


def fold(lens: Lens) -> float:
    """Smallest squared radius on the plane where the distorted radius stops growing; infinity if it never does."""
    above, below = (np.polynomial.Polynomial((1.0, *numbers)) for numbers in (lens.radial, lens.denominator))
    square = np.polynomial.Polynomial((0.0, 1.0))
    # d/dr of r N(r²) / D(r²), without the factor 1 / D², as a polynomial of r²
    slope = (above + 2 * square * above.deriv()) * below - 2 * square * above * below.deriv()
    roots = np.concatenate([slope.trim().roots(), below.trim().roots()])
    real = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].real
    return float(real.min()) if len(real) else float("inf")
