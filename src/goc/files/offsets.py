"""Coordinates far from their origin, such as national grids': moved before they become single precision."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Float64

from goc.errors import FileError

_FAR = 100.0
"""Distance from the origin, in sizes of the thing, from which on it is moved: nearer, float32 keeps 1/80,000 of it."""
_ROUND = 10.0
_FEWEST_STEPS = 200
"""Different values along the longest side that measured points have at least."""
_FEWEST, _FEW_POINTS = 4, 1000
"""Points that have a size, and those of which values can be counted."""
_WIDE = 0.2
"""Share of the longest side along which a thing is wide enough to count its values."""


def recentred(path: Path, positions: Float[np.ndarray, "p 3"]) -> tuple[Float32[np.ndarray, "p 3"], np.ndarray]:
    """Positions in single precision, about a nearby origin if their own is far away.

    Args:
        path: named in errors.
        positions: in the file's frame; not finite ones are kept as they are.

    Returns:
        The moved positions; and what to add to get those of the file, whole tens: zeros where nothing was moved.

    Raises:
        FileError: points far away that lost their digits before they came here.
    """
    offset = _offset(positions)
    if offset.any():
        _check_digits(path, positions)
    with np.errstate(over="ignore", invalid="ignore"):  # doubles beyond float32 become infinite
        return (positions.astype(np.float64) - offset).astype(np.float32), offset


def _offset(positions: Float[np.ndarray, "p 3"]) -> Float64[np.ndarray, "3"]:
    known = positions[np.isfinite(positions).all(axis=1)].astype(np.float64)
    if len(known) < _FEWEST:
        return np.zeros(3)
    middle = np.median(known, axis=0)
    with np.errstate(over="ignore"):
        size = 2 * float(np.quantile(np.abs(known - middle).max(axis=1), 0.9))  # whatever a few stray points do
    far = np.abs(middle).max() > _FAR * max(size, 1e-12) and np.abs(middle).max() > _FAR
    return np.round(middle / _ROUND) * _ROUND if far and np.isfinite(size) else np.zeros(3)


def _check_digits(path: Path, positions: Float[np.ndarray, "p 3"]) -> None:
    known = positions[np.isfinite(positions).all(axis=1)]
    if len(known) < _FEW_POINTS:
        return
    reach = np.ptp(known, axis=0).astype(np.float64)
    values = [np.unique(column) for column in known.T]
    few = [axis for axis in range(3) if len(values[axis]) < _FEWEST_STEPS * reach[axis] / reach.max()]
    steps = [float(np.median(np.diff(values[axis]))) for axis in few if reach[axis] > _WIDE * reach.max()]
    if steps:
        raise FileError(
            f"{path}: its {len(known):,} points are {max(steps):.2g} apart in steps, for want of digits this far from "
            "the origin. Write them in double precision, or nearer to it."
        )
