"""Where views do not agree through depth: which reading of the same numbers would make them agree."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from goc.capture.checks.agreement import CLOSE, Agreement, agreement
from goc.capture.checks.depth_views import DepthViews
from goc.capture.checks.readings import (
    OPTION,
    Evidence,
    Reading,
    depth_readings,
    inverted,
    mixed_readings,
    pairing_readings,
    pose_readings,
    raster_readings,
    scaled,
)

CONVINCING = 0.9
"""Share of agreeing points from which on a reading explains a capture."""
_BETTER = 0.5
"""Share of the disagreement that a reading may leave."""
_FITTER, _LEAST_FIT = 0.05, 0.35
"""What a reading must gain in points that agree, and how many must: where most are hidden, `share` proves little."""
_PROMISING = 0.6
_SIMPLER = 0.01
"""What a later reading must be better by, to be preferred to an earlier one."""
_FACTORS = np.geomspace(1e-4, 1e4, 161)  # steps of 6 %: some factor is within 3 %
_UNITS = {
    1.0: "metres",
    100.0: "centimetres",
    1000.0: "millimetres",
    10000.0: "tenths of a millimetre",
    5000.0: "millimetres x 5 (TUM RGB-D)",
    6553.5: "1/6553.5 m (Replica)",
    8000.0: "millimetres x 8 (bits shifted by 3)",
    4000.0: "quarters of a millimetre",
    2000.0: "half millimetres",
    256.0: "1/256 m (KITTI)",
    39.37: "inches",
}
"""Steps of depth in a metre, as files have them."""
_SAME_UNIT = 0.03


def explain(evidence: Evidence, stated: Agreement) -> tuple[Reading, Agreement] | None:
    """Find the reading under which views agree; None where none does, or hardly better than as stated.

    Simple mistakes are tried before pairs of them: direction and axes of poses, the meaning of depth, its unit,
    intrinsics and lens, the order of files, then axes together with the unit.
    """
    light = evidence.thinned(10, 100)
    groups = (
        _both(pose_readings, evidence, light),
        _both(depth_readings, evidence, light),
        _unit_readings(evidence, light),
        _both(raster_readings, evidence, light),
        _both(pairing_readings, evidence, light),
        _both(mixed_readings, evidence, light),
        _posed_units(evidence, light),
    )
    for group in groups:  # generators: later ones cost nothing where an earlier one explains
        found = _best(group)
        if found is not None and _convinces(found[1], stated):
            return found
    return None


def _both(
    readings: Callable[[Evidence], Iterable[Reading]], evidence: Evidence, light: Evidence
) -> Iterable[tuple[Reading, Reading]]:
    yield from zip(readings(evidence), readings(light), strict=True)


def _convinces(found: Agreement, stated: Agreement) -> bool:
    better = 1 - found.share < _BETTER * (1 - stated.share) and found.fit > stated.fit + _FITTER
    return better and found.share >= CONVINCING and found.fit >= _LEAST_FIT


def _best(pairs: Iterable[tuple[Reading, Reading]]) -> tuple[Reading, Agreement] | None:
    """The best of some readings: each is tried on few points, the promising ones on all."""
    best: tuple[Reading, Agreement] | None = None
    for full, light in pairs:
        if agreement(light.views, needs_parallax=True).share < _PROMISING:
            continue
        tried = agreement(full.views, needs_parallax=True)
        if best is None or tried.share > best[1].share + _SIMPLER:
            best = full, tried
    return best


def _unit_readings(evidence: Evidence, light: Evidence) -> Iterable[tuple[Reading, Reading]]:
    """Depth or positions in another unit, or disparity for depth."""
    factor = _factor(light.views)
    yield _in_unit(evidence, factor), _in_unit(light, factor)
    full, few = inverted(evidence.views), inverted(light.views)
    factor = _factor(few)
    looks, remedy = "depth looks like disparity (1/z)", "Pass --capture.depth-kind inverse, or store z."
    first, second = (Reading(looks=looks, remedy=remedy, views=scaled(each, factor)) for each in (full, few))
    yield first, second


def _posed_units(evidence: Evidence, light: Evidence) -> Iterable[tuple[Reading, Reading]]:
    """Direction or axes of the poses, and the unit too."""
    for full, few in _both(pose_readings, evidence, light):
        factor = _factor(few.views)
        options = full.remedy.removesuffix(".") + " "
        made = (
            _in_unit(replace(evidence, views=full.views), factor),
            _in_unit(replace(light, views=few.views), factor),
        )
        first, second = (
            replace(each, looks=f"{full.looks}, and {each.looks}", remedy=each.remedy.replace("Pass ", options))
            for each in made
        )
        yield first, second


def _factor(views: DepthViews) -> float:
    """The factor of depth that makes views agree best, to about half a percent where they agree at all."""
    best, share = _best_factor(views.thinned(np.arange(len(views)), 50), _FACTORS, CLOSE)
    return _best_factor(views, best * np.geomspace(0.95, 1.05, 21), 0.01)[0] if share > _PROMISING else best


def _best_factor(views: DepthViews, candidates: Float64[np.ndarray, "k"], close: float) -> tuple[float, float]:
    tried = [agreement(scaled(views, one), close, needs_parallax=True) for one in candidates.tolist()]
    best = int(np.argmax([each.fit for each in tried]))
    return float(candidates[best]), tried[best].share


def _in_unit(evidence: Evidence, factor: float) -> Reading:
    """Depth times a factor: a unit that people use, if it is one, else positions of unknown scale."""
    middle = float(np.nanmedian(evidence.views.values))
    steps = evidence.depth_steps / factor
    named = next((unit for unit in _UNITS if abs(steps / unit - 1) < _SAME_UNIT), None)
    if named is not None and (_plausible(middle * factor) or not _plausible(middle)):
        looks, remedy = f"depth looks like {_UNITS[named]}", f"{OPTION}.depth-unit {1 / named:.6g}"
    else:
        looks = f"positions look {factor:.4g} times as large as depth says (structure from motion knows no scale)"
        remedy = f"{OPTION}.pose-unit {1 / factor:.5g}"
    return Reading(looks=looks, remedy=f"Pass {remedy}.", views=scaled(evidence.views, factor))


def _plausible(metres: float) -> bool:
    return 0.2 < metres < 12
