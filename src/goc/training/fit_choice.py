"""Fits the lines that `choose` reads: ridge regression of the logarithm of the error, shared between candidates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from goc.complete.candidates import HULL
from goc.complete.choice import OPEN, VERSION, Calibration, Line
from goc.complete.features import FEATURES

_SHARED, _OWN = 8.0, 12.0
"""Ridge penalties, in cases: on slopes that all candidates share, and on what each adds to them."""
_FOLDS = 6
_LEAST = 1e-3
"""Errors below this share of the longest side are alike: no sampling of surfaces tells them apart."""
_FEWEST = 8
"""Cases below which a candidate is left out of the choice."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One object of which the truth is known: its candidates' features and errors."""

    shape: str
    """Cases of one shape are never split between fitting and testing."""
    group: str
    names: tuple[str, ...]
    rows: Float64[np.ndarray, "m f"]
    errors: Float64[np.ndarray, "m"]
    """Chamfer distances, in longest sides of what was measured."""
    open_error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    names: np.ndarray
    rows: Float64[np.ndarray, "n f"]
    levels: Float64[np.ndarray, "n"]
    shapes: np.ndarray


def fit_calibration(cases: Sequence[Case]) -> Calibration:
    """The calibration of least squared error in the logarithm; spreads are measured across folds of shapes.

    Raises:
        ValueError: fewer than eight cases.
    """
    if len(cases) < _FEWEST:
        raise ValueError(f"A calibration needs {_FEWEST} cases or more; got {len(cases)}.")
    table = _table(cases)
    shapes = np.unique(table.shapes)
    fold = {shape: number % _FOLDS for number, shape in enumerate(np.random.default_rng(0).permutation(shapes))}
    folds = np.array([fold[shape] for shape in table.shapes])
    missed = np.full(len(table.rows), np.nan)
    for number in range(_FOLDS):
        held = folds == number
        if held.any() and not held.all():
            slopes = _slopes(table, ~held)
            missed[held] = table.levels[held] - _levels(table, slopes)[held]
    slopes = _slopes(table, np.ones(len(folds), bool))
    kept = {name: slope for name, slope in slopes.items() if (table.names == name).sum() >= _FEWEST}
    return Calibration(
        schema=VERSION,
        features=list(FEATURES),
        low=table.rows.min(axis=0).tolist(),
        high=table.rows.max(axis=0).tolist(),
        lines={
            name: Line(slopes=slope.tolist(), spread=float(np.sqrt(np.nanmean(missed[table.names == name] ** 2))))
            for name, slope in kept.items()
        },
        cases=len(cases),
    )


def _table(cases: Sequence[Case]) -> _Table:
    names, rows, errors, shapes = [], [], [], []
    for case in cases:
        opened = case.rows[case.names.index(HULL)]
        names += [*case.names, OPEN]
        rows += [*case.rows, opened]
        errors += [*case.errors, case.open_error]
        shapes += [case.shape] * (len(case.names) + 1)
    return _Table(
        names=np.array(names),
        rows=np.stack(rows),
        levels=np.log(np.maximum(np.array(errors), _LEAST)),
        shapes=np.array(shapes),
    )


def _slopes(table: _Table, used: np.ndarray) -> dict[str, Float64[np.ndarray, "f"]]:
    """Slopes by name: those that all share, and what each candidate adds. The open surface shares nothing."""
    rows, names, levels = table.rows[used], table.names[used], table.levels[used]
    middle, scale = rows.mean(axis=0), np.maximum(rows.std(axis=0), 1e-6)
    middle[0], scale[0] = 0.0, 1.0  # the first column is one everywhere
    even = (rows - middle) / scale
    found = {}
    closed = names != OPEN
    known = list(np.unique(names[closed]))
    width = even.shape[1]
    design = np.zeros((int(closed.sum()), width * (len(known) + 1)))
    design[:, :width] = even[closed]
    for number, name in enumerate(known, 1):
        own = names[closed] == name
        design[own, number * width : (number + 1) * width] = even[closed][own]
    penalty = np.concatenate([np.full(width, _SHARED), np.full(width * len(known), _OWN)])
    penalty[::width] = 0.05
    solved = _ridge(design, levels[closed], penalty).reshape(-1, width)
    for number, name in enumerate(known, 1):
        found[str(name)] = _raw(solved[0] + solved[number], middle, scale)
    bare = _ridge(even[~closed], levels[~closed], np.array([0.05] + [1.0] * (width - 1)))
    return found | {OPEN: _raw(bare, middle, scale)}


def _ridge(
    design: Float64[np.ndarray, "n k"], levels: Float64[np.ndarray, "n"], penalty: Float64[np.ndarray, "k"]
) -> Float64[np.ndarray, "k"]:
    return np.linalg.solve(design.T @ design + np.diag(penalty), design.T @ levels)


def _raw(
    even: Float64[np.ndarray, "f"], middle: Float64[np.ndarray, "f"], scale: Float64[np.ndarray, "f"]
) -> Float64[np.ndarray, "f"]:
    """Slopes of the features as they are, from those of features with mean 0 and deviation 1."""
    slopes = even / scale
    slopes[0] -= float(slopes[1:] @ middle[1:])
    return slopes


def _levels(table: _Table, slopes: dict[str, Float64[np.ndarray, "f"]]) -> Float64[np.ndarray, "n"]:
    """Logarithms of the errors that the slopes tell; NaN for candidates of which there are none."""
    none = np.full(table.rows.shape[1], np.nan)
    return np.array([row @ slopes.get(str(name), none) for row, name in zip(table.rows, table.names, strict=True)])
