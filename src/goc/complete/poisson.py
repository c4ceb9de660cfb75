"""Screened Poisson surface reconstruction (Kazhdan and Hoppe 2013) on a dense grid, solved by sine transforms."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Float32
from scipy import fft, ndimage

from goc.complete.hull import BAND
from goc.scene import EvidenceGrid

Grid = Float32[np.ndarray, "x y z"]

_BLUR = 1.5
"""Standard deviation of the Gaussian that smooths the points' normals, voxels."""
_SCREEN = 2.0
"""How much a voxel that holds surface pulls the indicator to its level there, against a voxel of its Laplacian."""
_ROUNDS = 30
_ENOUGH = 1e-2
"""Share of the first residual at which the screened solution counts as found."""


def poisson_fill(
    points: Float[np.ndarray, "p 3"], normals: Float32[np.ndarray, "p 3"], grid: EvidenceGrid
) -> Float32[np.ndarray, "x y z"]:
    """Signed distance, in voxels and to first order, to the smoothest closed surface that has the points' normals.

    The indicator of the inside has the smeared normals for its gradient: its Laplacian is their divergence, it is 0 on
    the border of the grid, and the surface is where it takes the mean of its values at the points. Screening pulls it
    to that value at the points, so that the surface passes through them.

    Args:
        points: world, inside the grid.
        normals: unit, outwards.
        grid: whose voxels are filled.

    Returns:
        Positive outside, cut off at BAND.
    """
    at = ((points - grid.origin) / grid.voxel).astype(np.float32)
    # One more than a side must be a product of small primes, or its transform takes ten times as long.
    shape = tuple(int(fft.next_fast_len(n + 1, real=True)) - 1 for n in grid.state.shape)
    density = _splatted(at, np.ones(len(at), np.float32), shape)
    wide = ndimage.gaussian_filter(density, _BLUR)
    usual = float(np.median(wide[_voxels(at)]))
    even = np.minimum(wide / usual, 1.0) / np.maximum(wide, 0.05 * usual)  # each part once, however dense its points
    parts = (ndimage.gaussian_filter(_splatted(at, normals[:, axis], shape), _BLUR) * even for axis in range(3))
    source = sum(np.gradient(part, axis=axis) for axis, part in enumerate(parts))
    # Normals look outwards and the indicator falls outwards: minus its Laplacian is the divergence of the normals.
    inside = _screened(source.astype(np.float32), at, density)
    level = float(ndimage.map_coordinates(inside, at.T, order=1).mean())
    slope = np.sqrt(sum(np.gradient(inside, axis=axis) ** 2 for axis in range(3)))
    steepest = float(ndimage.map_coordinates(slope, at.T, order=1).mean())
    distance = (level - inside) / np.maximum(slope, 0.1 * steepest)
    kept = tuple(slice(n) for n in grid.state.shape)
    return np.clip(distance[kept], -BAND, BAND).astype(np.float32)


def _screened(source: Grid, at: Float32[np.ndarray, "p 3"], density: Grid) -> Grid:
    """The function f, 0 just outside the grid, with −Δf + w (f − level) = source; w where points are."""
    inverse = _inverse_laplacian(source.shape)
    free = inverse(source)
    level = np.float32(ndimage.map_coordinates(free, at.T, order=1).mean())
    usual = np.float32(np.median(density[_voxels(at)]))
    pull = np.float32(_SCREEN) * np.minimum(density / usual, 1)
    return _conjugate_gradients(lambda f: _minus_laplacian(f) + pull * f, inverse, source + pull * level, free)


def _conjugate_gradients(
    apply: Callable[[Grid], Grid], precondition: Callable[[Grid], Grid], right: Grid, x: Grid
) -> Grid:
    """Solve apply(x) = right from a first guess (Hestenes and Stiefel 1952), preconditioned."""
    residual = right - apply(x)
    first = float(np.linalg.norm(residual))
    way, before = np.zeros_like(x), np.inf
    for _ in range(_ROUNDS):
        if not np.linalg.norm(residual) > _ENOUGH * first:
            break
        better = precondition(residual)
        now = float(np.vdot(residual, better))
        way = better + np.float32(now / before) * way
        moved = apply(way)
        length = np.float32(now / float(np.vdot(way, moved)))
        x, residual, before = x + length * way, residual - length * moved, now
    return x


def _minus_laplacian(field: Grid) -> Grid:
    wide = np.pad(field, 1)
    middle = slice(1, -1)
    result = 6 * field
    for axis in range(3):
        for end in (slice(None, -2), slice(2, None)):
            result -= wide[tuple(end if a == axis else middle for a in range(3))]
    return result


def _inverse_laplacian(shape: tuple[int, ...]) -> Callable[[Grid], Grid]:
    """Solver of −Δf = right with f = 0 just outside the grid: sine waves are the Laplacian's eigenvectors."""
    bends = [(2.0 - 2.0 * np.cos(np.pi * (np.arange(n) + 1) / (n + 1))).astype(np.float32) for n in shape]
    size = bends[0][:, None, None] + bends[1][:, None] + bends[2]
    return lambda right: fft.idstn(fft.dstn(right, type=1) / size, type=1)


def _voxels(at: Float32[np.ndarray, "p 3"]) -> tuple[np.ndarray, ...]:
    return tuple(np.floor(at).astype(int).T)


def _splatted(at: Float32[np.ndarray, "p 3"], values: Float32[np.ndarray, "p"], shape: tuple[int, ...]) -> Grid:
    """Sums of values distributed to the eight voxels round each point, by trilinear weights."""
    low = np.floor(at).astype(np.int64)
    share = at - low
    total = np.zeros(int(np.prod(shape)))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, share, 1 - share), axis=1)
        place = np.ravel_multi_index(tuple((low + np.array(corner)).T), shape)
        total += np.bincount(place, weight * values, minlength=len(total))
    return total.reshape(shape).astype(np.float32)
