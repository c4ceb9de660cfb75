"""The damage list: blurred frames, exposure jumps, poses off the depth, and ids that do not hold still."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from goc.capture.inspect.inspection import IdDamage, ViewDamage
from goc.capture.inspect.looks import Look, neighbours
from goc.capture.inspect.pairs import Shared
from goc.scene import ROOM

_REACH = 5
_BLURRED = 0.6
"""Sharpness below this share of the neighbours' median; 0.75 to 1.3 are common in sharp captures."""
_JUMP, _STEADY = 0.35, 0.75
"""Stops off the neighbours, and the share of them that must say brighter, or darker."""
_OFF_CM, _OFF_TIMES = 1.5, 2.5
"""A view is off if it is by so much, and by so many times what views are in the median."""
_PAIRS = 3
"""Neighbours that a view must share surface with, for its pose to be judged."""
_MOSTLY, _PARTLY = 0.6, 0.25
"""Shares of an object's points in a view that have another id."""
_FEW_POINTS = 12
_SURE_VIEWS = 2
"""Views in which an object is called otherwise, for that to be told."""


def blurred_views(looks: Sequence[Look]) -> list[ViewDamage]:
    """Views less sharp than those just before and after them."""
    found = []
    for row, look in enumerate(looks):
        others = [near.sharpness for near in neighbours(looks, row, _REACH)]
        share = look.sharpness / max(float(np.median(others)), 1e-9) if len(others) >= 3 else 1.0
        if share < _BLURRED:
            detail = f"{100 * share:.0f} % of the sharpness of its neighbours"
            found.append(ViewDamage(view=look.name, what="blurred", detail=detail, value=round(share, 3)))
    return sorted(found, key=lambda one: one.value)


def exposure_jumps(looks: Sequence[Look], shared: Sequence[Shared]) -> list[ViewDamage]:
    """Views whose surfaces are brighter or darker than the same ones in others; without depth, whose whole image is."""
    off = _levels_of_surfaces(shared) or _levels_of_images(looks)
    found = []
    for row, stops in sorted(off.items(), key=lambda one: -abs(one[1])):
        if abs(stops) > _JUMP:
            word = "brighter" if stops > 0 else "darker"
            detail = f"{abs(stops):.1f} stops {word} than its neighbours"
            found.append(ViewDamage(view=looks[row].name, what="exposure", detail=detail, value=round(stops, 3)))
    return found


def _levels_of_surfaces(shared: Sequence[Shared]) -> dict[int, float]:
    told = defaultdict(list)
    for pair in shared:
        if np.isfinite(pair.stops):
            told[pair.there].append(pair.stops)
    # most neighbours must say so: how a surface shines depends on where it is seen from
    steady = {row: np.array(values) for row, values in told.items() if len(values) >= 3}
    return {
        row: float(np.median(values))
        for row, values in steady.items()
        if (np.sign(values) == np.sign(np.median(values))).mean() > _STEADY
    }


def _levels_of_images(looks: Sequence[Look]) -> dict[int, float]:
    levels = [float(np.log2(np.median(look.grey) + 1e-3)) for look in looks]
    off = {}
    for row in range(len(looks)):
        near = [levels[at] for at in range(len(looks)) if 0 < abs(at - row) <= 2]
        # both neighbours must differ the same way: a walk towards a window changes brightness slowly
        gaps = [levels[row] - other for other in near]
        if len(gaps) >= 3 and (min(gaps) > 0 or max(gaps) < 0):
            off[row] = min(gaps, key=abs)
    return off


def poses_off(
    looks: Sequence[Look], shared: Sequence[Shared], units_per_metre: float
) -> tuple[list[ViewDamage], float | None]:
    """Views whose depth lies elsewhere than their neighbours'; and the median over all views, cm."""
    gaps = defaultdict(list)
    for pair in shared:
        gaps[pair.here].append(float(np.median(np.abs(pair.gap))) * 100 / units_per_metre)
    off = {row: float(np.median(values)) for row, values in gaps.items() if len(values) >= _PAIRS}
    if not off:
        return [], None
    typical = float(np.median(list(off.values())))
    limit = max(_OFF_CM, _OFF_TIMES * typical)
    found = [
        ViewDamage(
            view=looks[row].name,
            what="pose",
            detail=f"{cm:.1f} cm off its neighbours in the median, others {typical:.1f} cm",
            value=round(cm, 2),
        )
        for row, cm in off.items()
        if cm > limit
    ]
    return sorted(found, key=lambda one: -one.value), round(typical, 3)


def unsteady_ids(looks: Sequence[Look], shared: Sequence[Shared]) -> list[IdDamage]:
    """Objects whose points have no id, another id, or two ids in some views."""
    told: dict[tuple[int, str, int | None], set[int]] = defaultdict(set)
    for (number, row), others in _ids_by_view(shared).items():
        labels, counts = np.unique(others, return_counts=True)
        shares = dict(zip(labels.tolist(), (counts / counts.sum()).tolist(), strict=True))
        lost = sum(share for label, share in shares.items() if label <= ROOM)
        named = {label: share for label, share in shares.items() if label > ROOM and label != number}
        most = max(named, key=lambda label: named[label], default=None)
        if lost > _MOSTLY:
            told[number, "flickers", None].add(row)
        elif most is not None and named[most] > _MOSTLY:
            told[number, "merges", most].add(row)
        elif most is not None and named[most] > _PARTLY and shares.get(number, 0.0) > _PARTLY:
            told[number, "splits", most].add(row)
    return [
        IdDamage(id=number, what=what, other=other, views=[looks[row].name for row in sorted(rows)])
        for (number, what, other), rows in sorted(told.items(), key=lambda one: (-len(one[1]), one[0][0]))
        if len(rows) >= _SURE_VIEWS
    ]


def _ids_by_view(shared: Sequence[Shared]) -> dict[tuple[int, int], np.ndarray]:
    """What the points of each object, as other views tell them, are called in each view."""
    gathered = defaultdict(list)
    for pair in shared:
        if pair.own is not None and pair.other is not None:
            for number in np.unique(pair.own[pair.own > ROOM]).tolist():
                gathered[number, pair.there].append(pair.other[pair.own == number])
    joined = {key: np.concatenate(parts) for key, parts in gathered.items()}
    return {key: values for key, values in joined.items() if len(values) >= _FEW_POINTS}


def rarely_seen(views_of: dict[int, int], looked_at: int) -> list[int]:
    """Ids of objects that fewer than three views show, or 3 % of them where that is more."""
    least = max(3, round(0.03 * looked_at))
    return sorted(number for number, views in views_of.items() if views < least)
