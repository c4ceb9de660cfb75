"""Smooth pseudo-random fields in space for procedural textures; the same in every run."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32

from goc import _native

_PERIOD = 64


@lru_cache(maxsize=1)
def _lattice() -> Float[np.ndarray, "x y z"]:
    return np.random.default_rng(20260101).random((_PERIOD,) * 3, np.float32)


def value_noise(points: Float[np.ndarray, "p 3"]) -> Float32[np.ndarray, "p"]:
    """Random values at the integer lattice, smoothly interpolated, in [0, 1]; repeats after 64 units."""
    return fractal_noise(points, 1)


def fractal_noise(points: Float[np.ndarray, "p 3"], octaves: int) -> Float32[np.ndarray, "p"]:
    """Octaves of value noise, each twice as fine and half as strong, in [0, 1]."""
    values = np.zeros(len(points), np.float32)
    _native.fractal_noise(np.ascontiguousarray(points, np.float64), _lattice(), octaves, values)
    return values


def cell_random(cells: Float[np.ndarray, "p k"]) -> Float[np.ndarray, "p"]:
    """One random value in [0, 1] for each integer cell, such as a plank or a tile."""
    index = cells.astype(np.int64) % _PERIOD
    padded = np.zeros((len(cells), 3), np.int64)
    padded[:, : index.shape[1]] = index
    return _lattice()[padded[:, 0], padded[:, 1], padded[:, 2]]
