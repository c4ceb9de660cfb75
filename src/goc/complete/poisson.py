"""Closing by normals alone: Poisson surface reconstruction (Kazhdan et al. 2006), by sine transforms."""

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy import fft, ndimage

from goc.complete.hull import BAND
from goc.scene import EvidenceGrid

_BLUR = 1.5
"""Width of a point's smear, voxels."""


def poisson_fill(
    points: Float[np.ndarray, "p 3"], normals: Float32[np.ndarray, "p 3"], grid: EvidenceGrid
) -> Float32[np.ndarray, "x y z"]:
    """Signed distance, in voxels and to first order, to the smoothest closed surface that has the points' normals.

    The indicator of the inside has the smeared normals for its gradient: its Laplacian is their divergence, it is 0 on
    the border of the grid, and the surface is where it takes the mean of its values at the points.

    Args:
        points: world, inside the grid.
        normals: unit, outwards.
        grid: whose voxels are filled.

    Returns:
        Positive outside, cut off at BAND.
    """
    at = ((points - grid.origin) / grid.voxel).astype(np.float64)
    smeared = _smeared(at, normals.astype(np.float64), grid.state.shape)
    divergence = sum(np.gradient(smeared[..., axis], axis=axis) for axis in range(3))
    inside = _solved(-divergence)  # normals look outwards, the indicator falls outwards: its gradient is their opposite
    level = float(ndimage.map_coordinates(inside, at.T, order=1).mean())
    slope = np.sqrt(sum(np.gradient(inside, axis=axis) ** 2 for axis in range(3)))
    steepest = float(ndimage.map_coordinates(slope, at.T, order=1).mean())
    distance = (level - inside) / np.maximum(slope, 0.1 * steepest)
    return np.clip(distance, -BAND, BAND).astype(np.float32)


def _smeared(
    at: Float64[np.ndarray, "p 3"], normals: Float64[np.ndarray, "p 3"], shape: tuple[int, ...]
) -> Float64[np.ndarray, "x y z 3"]:
    """Normals dealt to the eight voxels round each point, each part of a surface once, however dense its points."""
    low = np.clip(np.floor(at).astype(int), 0, np.array(shape) - 2)
    share = at - low
    field, density = np.zeros((*shape, 3)), np.zeros(shape)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, share, 1 - share), axis=1)
        place = tuple((low + np.array(corner)).T)
        np.add.at(density, place, weight)
        np.add.at(field, place, weight[:, None] * normals)
    density = ndimage.gaussian_filter(density, _BLUR)
    blurred = np.stack([ndimage.gaussian_filter(field[..., axis], _BLUR) for axis in range(3)], axis=-1)
    usual = float(np.median(density[tuple(low.T)]))
    return blurred / np.maximum(density, 0.05 * usual)[..., None] * np.minimum(density / usual, 1.0)[..., None]


def _solved(right: Float64[np.ndarray, "x y z"]) -> Float64[np.ndarray, "x y z"]:
    """The function of the given Laplacian that is 0 just outside the grid."""
    waves = fft.dstn(right, type=1)
    bends = [2.0 * np.cos(np.pi * (np.arange(n) + 1) / (n + 1)) - 2.0 for n in right.shape]
    return fft.idstn(waves / (bends[0][:, None, None] + bends[1][:, None] + bends[2]), type=1)
