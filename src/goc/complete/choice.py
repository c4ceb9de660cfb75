"""Which candidate to trust: that of least expected error, calibrated on shapes of which the truth is known."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float64

from goc.complete.candidates import HULL, Candidate, Filler, Grid, candidates, coarsened, hypotheses, refined
from goc.complete.compose import Measured
from goc.complete.features import FEATURES, features, longest_side
from goc.errors import CompleteError
from goc.files import read_versioned

VERSION = 1
"""Version of the calibration's file. Raise it whenever a feature changes its meaning."""
CALIBRATION = Path(str(resources.files("goc.complete"))) / "weights" / "choice.json"
"""The calibration inside the package, made with the weights beside it by `goc osc calibrate`."""
_DOUBT = 1.5
"""A completion is doubted if it is expected to be this many times as far from the truth as the open surface."""
OPEN = "open"
"""The name under which the calibration keeps the error of a surface that is left open."""


class Line(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How one candidate's error follows from its features."""

    slopes: list[float]
    """Of the logarithm of the error, one for each of FEATURES."""
    spread: float
    """Standard deviation of what was left, on shapes that the line was not fitted to."""


class Calibration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of choice.json."""

    schema: int
    features: list[str]
    low: list[float]
    high: list[float]
    """Range of each feature that was met; beyond it nothing is extrapolated."""
    lines: dict[str, Line]
    """By the name of the candidate; OPEN among them, which follows from the hull's features."""
    cases: int
    """Objects that it was fitted to."""

    def expected(self, name: str, row: Float64[np.ndarray, "f"]) -> float:
        """Expected chamfer distance, in longest sides of what was measured; infinite for a name that is not known."""
        line = self.lines.get(name)
        if line is None:
            return math.inf
        level = float(np.clip(row, self.low, self.high) @ np.array(line.slopes))
        return math.exp(min(level + line.spread**2 / 2, 0.0))  # no error is larger than the object


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The candidate that was chosen for one object."""

    name: str
    expected_error: float
    """Chamfer distance to the true surface that is to be expected, units of the scene."""
    open_error: float
    """The same of the measured surface, had it been left open."""

    @property
    def trusted(self) -> bool:
        """Whether completing is expected to be no worse than not to, as surely as expectations are."""
        return self.expected_error <= _DOUBT * self.open_error


def read_calibration(path: Path = CALIBRATION) -> Calibration:
    """Read what `goc osc calibrate` wrote.

    Raises:
        FileError: missing, malformed, or of another version.
        CompleteError: made for other features, or without the hull, which is what always applies.
    """
    found = read_versioned(path, Calibration, VERSION, "Make it again with `goc osc calibrate`")
    sizes = {len(line.slopes) for line in found.lines.values()} | {len(found.low), len(found.high)}
    if tuple(found.features) != FEATURES or sizes != {len(FEATURES)} or not {HULL, OPEN} <= set(found.lines):
        raise CompleteError(f"{path}: made for other features than goc computes. Make it again: goc osc calibrate.")
    return found


def choose(found: Measured, options: Sequence[Candidate], calibration: Calibration) -> Choice:
    """The candidate of least expected error; where none is better than the open surface, the one that adds least.

    Args:
        found: what was measured.
        options: of the same object, the hull among them.
        calibration: see `read_calibration`.
    """
    rows, longest = features(found, options), longest_side(found)
    names = [option.name for option in options]
    errors = np.array([calibration.expected(name, row) for name, row in zip(names, rows, strict=True)])
    bare = calibration.expected(OPEN, rows[names.index(HULL)])
    best = int(errors.argmin())
    if errors[best] > _DOUBT * bare:
        best = int(np.argmin([float((option.composed.distance < 0).sum()) for option in options]))
    return Choice(
        name=names[best],
        expected_error=float(errors[best]) * longest,
        open_error=bare * longest,
    )


def choose_for(found: Measured, network: Filler | None, calibration: Calibration) -> tuple[Grid | None, Choice]:
    """The fill to take, as `compose_field` takes it, and why: candidates are judged and filled in coarse voxels."""
    coarse = coarsened(found)
    options = list(candidates(found, hypotheses(coarse), network, coarse))
    made = choose(coarse, options, calibration)
    fill = next(option.fill for option in options if option.name == made.name)
    return (None if fill is None else refined(fill, coarse.evidence, found.evidence)), made
