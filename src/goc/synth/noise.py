"""Smooth pseudo-random fields in space, the same for the same seed: what makes procedural surfaces look grown."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

_PERIOD = 64
_STRIDES = np.array([_PERIOD * _PERIOD, _PERIOD, 1], np.int32)


@lru_cache(maxsize=1)
def _lattice() -> Float[np.ndarray, "x y z"]:
    return np.random.default_rng(20260101).random((_PERIOD,) * 3, np.float32)


def value_noise(points: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p"]:
    """Random values at the integer lattice, smoothly interpolated, in [0, 1]; repeats after 64 units."""
    floor = np.floor(points)
    step = (points - floor).astype(np.float32)
    x, y, z = (step * step * (3 - 2 * step)).T
    low = floor.astype(np.int32) % _PERIOD
    high = (low + 1) % _PERIOD
    (x0, y0, z0), (x1, y1, z1) = (low * _STRIDES).T, (high * _STRIDES).T
    values = _lattice().ravel()

    def edge(base: Int[np.ndarray, "p"]) -> Float[np.ndarray, "p"]:
        at_low, at_high = values[base + z0], values[base + z1]
        return at_low + z * (at_high - at_low)

    def side(base: Int[np.ndarray, "p"]) -> Float[np.ndarray, "p"]:
        near = edge(base + y0)
        return near + y * (edge(base + y1) - near)

    front = side(x0)
    return front + x * (side(x1) - front)


def fractal_noise(points: Float[np.ndarray, "p 3"], octaves: int) -> Float[np.ndarray, "p"]:
    """Octaves of value noise, each twice as fine and half as strong, in [0, 1]."""
    total = np.zeros(len(points), np.float32)
    for octave in range(octaves):
        total += 0.5**octave * value_noise(points * 2.0**octave + 17.3 * octave)
    return total / (2 - 0.5 ** (octaves - 1))


def cell_random(cells: Float[np.ndarray, "p k"]) -> Float[np.ndarray, "p"]:
    """One random value in [0, 1] for each integer cell, such as a plank or a tile."""
    index = cells.astype(np.int64) % _PERIOD
    padded = np.zeros((len(cells), 3), np.int64)
    padded[:, : index.shape[1]] = index
    return _lattice()[padded[:, 0], padded[:, 1], padded[:, 2]]
