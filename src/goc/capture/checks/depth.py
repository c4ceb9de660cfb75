"""Checks of metric depth: views must agree through it, and lengths must be those of a room."""

from collections.abc import Iterator

import numpy as np

from goc.capture.checks.agreement import Agreement, agreement
from goc.capture.checks.depth_views import DepthViews, depth_views
from goc.capture.checks.explain import explain
from goc.capture.checks.finding import Finding, contradiction, doubt
from goc.capture.checks.readings import PLATEAU, Evidence
from goc.capture.checks.sample import Sample
from goc.capture.source import count_of, shown
from goc.scene import Frame

_GOOD = 0.9
"""Share of agreeing points that right captures have: 0.95 to 1.0 measured, noise of sensors included."""
_BAD = 0.75
"""Below it no geometry can be right: a lens left out gives 0.85, distance for z 0.67, the rest less (record 0045)."""
_FEWEST = 150
"""Points that must be compared, for their share to mean anything."""
_LONGEST_M, _SHORTEST_M = 60.0, 0.03
_LONG_M, _SHORT_M = 20.0, 0.12
_NAMED = {1000.0: "millimetres", 100.0: "centimetres", 39.37: "inches"}


def depth_findings(sample: Sample) -> Iterator[Finding]:
    """What depth tells of itself, of the poses and of the unit."""
    if not sample.capture.has_metric_depth:
        return
    given = [frame for frame in sample.frames if frame.depth is not None]
    empty = [frame for frame in given if not _has_depth(frame)]
    if not given:
        return
    if len(empty) == len(given):
        yield contradiction(
            "depth-empty",
            f"the depth images of all {len(given)} views that were looked at hold nothing but 0. Write z along the "
            "axis (16-bit PNG, millimetres), or pass --capture.no-use-depth.",
        )
        return
    if empty:
        yield doubt("depth-empty", f"{count_of(empty, len(given))} depth images that were looked at hold nothing")
    rows = [row for row, frame in zip(sample.indices, sample.frames, strict=True) if _has_depth(frame)]
    evidence = Evidence(
        source=sample.source,
        views=depth_views(sample.frames),
        indices=tuple(rows),
        poses=sample.poses,
        kind=sample.kind,
    )
    yield from _plateau(sample, evidence)
    yield from _agreement(evidence)
    yield from _size(sample, evidence.views)


def _agreement(evidence: Evidence) -> Iterator[Finding]:
    views = evidence.views
    stated = agreement(views)
    if len(views) < 2 or stated.share >= _GOOD or not np.ptp(views.poses[:, :3, 3], axis=0).any():
        return
    found = explain(evidence, stated)
    says = f"views agree through depth in {_percent(stated)} of what they share"
    if found is not None and found[1].compared >= _FEWEST:
        reading, better = found
        told = f"{reading.looks}: as the capture says, {says}, read this way in {_percent(better)}. {reading.remedy}"
        yield contradiction("depth-agreement", told)
    elif stated.compared < _FEWEST:
        yield doubt("depth-agreement", "no two views that were looked at share what they see: poses cannot be checked")
    elif stated.share < _BAD:
        yield contradiction(
            "depth-agreement",
            f"depth and poses contradict each other: {says}, of a right capture in more than 90 %. Poses drifted, or "
            "depth is no z (of a network: --capture.depth-kind affine). Correct them, leave depth out "
            "(--capture.no-use-depth), or pass --capture.checks warn.",
        )
    else:
        yield doubt(
            "depth-agreement",
            f"{says} only, of a right capture in more than 90 %: poses drift, a lens's distortion is left out, or "
            "depth is not registered to the photographs",
        )


def _size(sample: Sample, views: DepthViews) -> Iterator[Finding]:
    """Everything in millimetres agrees with itself: only the size of things tells."""
    capture = sample.capture
    metres = views.typical / capture.units_per_metre
    if _SHORT_M <= metres <= _LONG_M:
        return
    unit = next((u for u in _NAMED if 0.3 <= metres / u <= 12), None) if metres > _LONG_M else None
    looks = f"everything looks to be in {_NAMED[unit]}" if unit else "the unit looks wrong"
    option = f"--capture.units-per-metre {unit:g}" if unit else "--capture.units-per-metre N"
    says = f"{looks}: things are {metres:.3g} m away in the median, as the capture says. Pass {option}"
    if _SHORTEST_M <= metres <= _LONGEST_M:
        yield doubt("size", f"{says} if that is wrong")
    elif capture.metric and sample.capture.units_per_metre == 1.0:
        yield contradiction("size", f"{says}, or --capture.checks warn if it is right.")
    else:
        yield doubt("size", f"{says} if that is wrong")


def _plateau(sample: Sample, evidence: Evidence) -> Iterator[Finding]:
    """One farthest value in many pixels of many views stands for `none`."""
    views = evidence.views
    farthest = float(np.nanmax(views.depth))
    shares = (views.depth == np.float32(farthest)).mean((1, 2))
    marked = shares > PLATEAU
    if np.median(shares) > 0.9:
        yield contradiction(
            "depth-constant",
            f"nearly every pixel has the same depth, {farthest:.4g}. Write z along the axis (16-bit PNG, millimetres), "
            "or pass --capture.no-use-depth.",
        )
    elif marked.sum() >= max(3, 0.5 * len(views)):
        value = farthest * evidence.depth_steps
        name = sample.capture.view_names[evidence.indices[int(np.argmax(shares))]]
        yield doubt(
            "depth-plateau",
            f"{100 * shares[marked].mean():.0f} % of the pixels have exactly the depth {value:.6g} in "
            f"{count_of(np.flatnonzero(marked).tolist(), len(views))} views (most: {shown(name)}): it looks like the "
            "mark of pixels without depth, which is 0",
        )


def _has_depth(frame: Frame) -> bool:
    return frame.depth is not None and bool(frame.depth.isfinite().any())


def _percent(agreed: Agreement) -> str:
    return f"{100 * agreed.share:.0f} %"
