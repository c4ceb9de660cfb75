"""Calibration: errors that follow from features are found again, and the tables say what they should."""

import numpy as np
import pytest

from goc.complete.candidates import CONVEX, HULL
from goc.complete.choice import OPEN
from goc.complete.features import FEATURES
from goc.training.fit_choice import Case, fit_calibration
from goc.training.reliability import reliability

SLOPES = {HULL: (-3.0, 0.5), CONVEX: (-4.0, -0.3), OPEN: (-3.5, 0.2)}


def case(number, noise=0.0):
    """Errors that are exactly log-linear in the second feature; the others are noise without a meaning."""
    random = np.random.default_rng(number)
    rows = random.normal(size=(2, len(FEATURES)))
    rows[:, 0] = 1.0
    levels = {
        name: np.exp(a + b * x) for (name, (a, b)), x in zip(SLOPES.items(), [*rows[:, 1], rows[0, 1]], strict=True)
    }
    spoilt = np.exp(noise * random.normal(size=2))
    return Case(
        shape=f"shape {number // 2}",
        group="few" if number % 2 else "many",
        names=(HULL, CONVEX),
        rows=rows,
        errors=np.array([levels[HULL], levels[CONVEX]]) * spoilt,
        open_error=levels[OPEN],
    )


def test_a_law_of_errors_is_found_again():
    found = fit_calibration([case(number) for number in range(400)])
    row = np.zeros(len(FEATURES))
    row[:2] = 1.0, 0.7
    for name, (level, slope) in SLOPES.items():
        line = found.lines[name]
        assert line.spread < 0.1
        assert found.expected(name, row) == pytest.approx(np.exp(level + slope * 0.7), rel=0.1)


def test_the_spread_is_that_of_cases_that_were_not_fitted_to():
    found = fit_calibration([case(number, noise=0.4) for number in range(300)])
    assert found.lines[CONVEX].spread == pytest.approx(0.4, rel=0.2)
    assert found.lines[OPEN].spread < 0.1


def test_the_tables_tell_what_was_expected_and_what_choosing_gains():
    cases = tuple(case(number, noise=0.1) for number in range(200))
    text = reliability(fit_calibration(cases), cases)
    bins, gains = text.split("\n\n")[0].splitlines()[2:], text
    assert len([line for line in bins if line.startswith("| 0.")]) >= 5
    ratio = float(bins[0].split("|")[5])
    assert ratio == pytest.approx(1.0, abs=0.1)
    assert "| few | 100 |" in gains and "| many | 100 |" in gains
    few = [float(cell) for cell in gains.split("| few | 100 |")[1].splitlines()[0].split("|")[:5]]
    bare, hull, convex, chosen, hindsight = few
    assert hindsight <= chosen <= min(hull, convex) < bare * 2
    assert reliability(fit_calibration(cases), ()).startswith("No cases")


def test_too_few_cases_are_refused():
    with pytest.raises(ValueError, match=r"needs 8 cases or more; got 3"):
        fit_calibration([case(number) for number in range(3)])
