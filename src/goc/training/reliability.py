"""What a calibration is worth, as tables: expected errors beside those that came about, and what choosing gains."""

import numpy as np
from jaxtyping import Float64

from goc.complete.candidates import HULL
from goc.complete.choice import OPEN, Calibration
from goc.training.fit_choice import Case

_BINS = 5


def reliability(calibration: Calibration, tested: tuple[Case, ...]) -> str:
    """Two Markdown tables, of cases that the calibration was not fitted to. Errors are shares of the longest side."""
    if not tested:
        return "No cases were held back: nothing is tested."
    chosen = [_chosen(calibration, case) for case in tested]
    expected = np.array([value for value, _ in chosen])
    found = np.array([case.errors[place] for case, (_, place) in zip(tested, chosen, strict=True)])
    return _bins(expected, found) + "\n" + _gains(tested, found, [place for _, place in chosen])


def _chosen(calibration: Calibration, case: Case) -> tuple[float, int]:
    errors = [calibration.expected(name, row) for name, row in zip(case.names, case.rows, strict=True)]
    return float(np.min(errors)), int(np.argmin(errors))


def _bins(expected: Float64[np.ndarray, "n"], found: Float64[np.ndarray, "n"]) -> str:
    """Means in groups of equal size, by the expected error, and how often it was met within a factor of two."""
    lines = ["| expected, up to | cases | expected | found | found/expected | within a factor of 2 |", "|---" * 6 + "|"]
    for part in np.array_split(np.argsort(expected), min(_BINS, len(expected))):
        ratio = found[part] / expected[part]
        near = float(((ratio > 0.5) & (ratio < 2.0)).mean())
        e, f = float(expected[part].mean()), float(found[part].mean())
        lines.append(f"| {expected[part].max():.4f} | {len(part)} | {e:.4f} | {f:.4f} | {f / e:.2f} | {near:.0%} |")
    return "\n".join(lines) + "\n"


def _gains(tested: tuple[Case, ...], found: Float64[np.ndarray, "n"], places: list[int]) -> str:
    """Mean errors by group of what was chosen, of single candidates, and of the best that hindsight could choose."""
    names = list(dict.fromkeys(name for case in tested for name in case.names))
    head = ["group", "cases", OPEN, *names, "chosen", "hindsight", "worse than hull and open by 10 %"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for group in dict.fromkeys(case.group for case in tested):
        rows = [number for number, case in enumerate(tested) if case.group == group]
        own = [tested[number] for number in rows]
        safe = np.array([min(case.open_error, case.errors[case.names.index(HULL)]) for case in own])
        means = [
            np.mean([case.open_error for case in own]),
            *(np.mean([_error(case, name) for case in own]) for name in names),
            found[rows].mean(),
            np.mean([case.errors.min() for case in own]),
        ]
        worse = int((found[rows] > 1.1 * safe).sum())
        lines.append(f"| {group} | {len(own)} | " + " | ".join(f"{mean:.4f}" for mean in means) + f" | {worse} |")
    lines.append("\nA candidate that does not apply counts as the hull. Chosen:")
    counts = {name: 0 for name in names}
    for case, place in zip(tested, places, strict=True):
        counts[case.names[place]] += 1
    lines.append(", ".join(f"{name} {count}" for name, count in counts.items()) + ".")
    return "\n".join(lines) + "\n"


def _error(case: Case, name: str) -> float:
    return float(case.errors[case.names.index(name if name in case.names else HULL)])
