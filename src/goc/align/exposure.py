"""One exposure for all photographs: gains and offsets from what pairs of views show of the same surface."""

from dataclasses import replace

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from jaxtyping import Float64

from goc.align.system import Look, PairSums

_HELD = 1e-3
"""What holds gains to 1 and offsets to 0, in typical pairs: views that nothing connects keep their exposure."""
_MID_GREY = 0.5
_ROUNDS = 4
"""Of reweighting pairs that do not fit the others."""
_ODD = 0.03
"""Difference from the others at which a pair counts a quarter."""


def channel_looks(look: Look) -> list[Look]:
    """Looks at each channel."""
    return [replace(look, channel=channel) for channel in range(3)]


def brightness_apart(found: PairSums) -> float:
    """How much brighter one photograph shows mid-grey than another, as a share: median over pairs, by their points.

    Not the spread of fitted gains: where a pair shows little contrast, gain and offset trade with each other.
    """
    gain, offset, points = found.shades[found.shades[:, 2] > 0].T
    change = np.abs(np.log(np.maximum(gain * _MID_GREY + offset, 1e-3) / _MID_GREY))
    order = np.argsort(change)
    heard = np.cumsum(points[order])
    return float(change[order][np.searchsorted(heard, heard[-1] / 2)]) if len(heard) else 0.0


def exposures(found: list[PairSums], count: int) -> Float64[np.ndarray, "v 3 2"]:
    """Gain and offset of each channel and view from a comparison a channel: given = gain · common + offset.

    A pair says gain = gain₂ / gain₁ and offset = offset₂ - gain · offset₁. Least squares over all pairs, in logarithms
    for gains; those that do not fit count less. The means over all views are 1 and 0.
    """
    return np.stack([_of_channel(sums, count) for sums in found], 1)


def _of_channel(found: PairSums, count: int) -> Float64[np.ndarray, "v 2"]:
    first, second = np.array(found.pairs, int).reshape(-1, 2).T
    gain, offset, points = found.shades.T
    weights = points / max(points.mean(), 1.0) if len(points) else points
    gains = np.exp(_levels(first, second, np.log(gain), weights, np.ones(len(gain)), count))
    gains /= np.exp(np.log(gains).mean())
    offsets = _levels(first, second, offset, weights, gains[second] / gains[first], count)
    return np.stack([gains, offsets - offsets.mean()], -1)


def _levels(
    first: np.ndarray,
    second: np.ndarray,
    steps: Float64[np.ndarray, "m"],
    weights: Float64[np.ndarray, "m"],
    factors: Float64[np.ndarray, "m"],
    count: int,
) -> Float64[np.ndarray, "v"]:
    """X with x[second] - factor · x[first] ≈ step, each pair by its weight; robust."""
    x, now = np.zeros(count), weights
    rows = np.tile(np.arange(len(steps)), 2)
    ends = np.concatenate([second, first])
    change = scipy.sparse.csr_array(
        (np.concatenate([np.ones(len(steps)), -factors]), (rows, ends)), (len(steps), count)
    )
    for _ in range(_ROUNDS):
        weighted = change.T.multiply(now).tocsr()
        matrix = weighted @ change + _HELD * scipy.sparse.eye_array(count)
        x = scipy.sparse.linalg.spsolve(matrix.tocsc(), weighted @ steps)
        now = weights / (1.0 + ((steps - change @ x) / _ODD) ** 2)
    return x
