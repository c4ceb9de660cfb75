"""An inspection in words, for the terminal and the page."""

from collections.abc import Iterator

import numpy as np

from goc.capture.inspect import Inspection
from goc.capture.inspect.inspection import IdDamage

_MOST = 8


def facts_of(told: Inspection) -> list[tuple[str, str]]:
    """What was found, as names and values."""
    sizes = ", ".join(f"{size.width} x {size.height}" for size in told.sizes[:3]) + (
        " …" if len(told.sizes) > 3 else ""
    )
    angles = {round(size.degrees) for size in told.sizes}
    facts = [
        ("format", told.format),
        ("views", str(told.views)),
        ("pixels, as used", sizes),
        ("angle of view", f"{min(angles)}°" if len(angles) == 1 else f"{min(angles)}° to {max(angles)}°"),
        ("lens", ", ".join(told.lenses)),
        ("depth", _depth(told)),
        ("ids", f"{len(told.objects)} objects" if told.has_ids else "none"),
        ("seed points", f"{told.seed_points:,}" if told.seed_points else "none"),
        ("unit", _unit(told)),
        ("up of the cameras", _up(told)),
        ("cameras spread over", f"{told.path_m:.2f} m"),
    ]
    if told.depth is not None and told.depth.gap_cm is not None:
        facts.append(("views agree to", f"{told.depth.gap_cm:.1f} cm"))
    return facts


def ids_words(told: Inspection) -> Iterator[tuple[IdDamage, str]]:
    """Each damage of ids with its words, without the views."""
    names = {one.id: one.name for one in told.objects}
    for one in told.ids_damage:
        other = f"{one.other} {names.get(one.other, '')}".strip() if one.other is not None else ""
        words = {"flickers": "has no id", "merges": f"is called {other}", "splits": f"is partly called {other}"}
        yield one, f"{one.id} {names.get(one.id, '')} {words[one.what]}"


def text_of(told: Inspection) -> str:
    """The report of the terminal."""
    lines = [told.path]
    lines += [f"  {name:<20} {value}" for name, value in facts_of(told)]
    lines += [f"{one.severity}: {one.message}" for one in told.findings]
    for what in ("pose", "blurred", "exposure"):
        rows = [one for one in told.damage if one.what == what]
        lines += [f"{what}: {one.view}, {one.detail}" for one in rows[:_MOST]]
        lines += [f"{what}: {len(rows) - _MOST} more views"] if len(rows) > _MOST else []
    unsteady = list(ids_words(told))
    for one, words in unsteady[:_MOST]:
        lines.append(f"ids: {words} in {len(one.views)} views (first: {one.views[0]})")
    lines += [f"ids: {len(unsteady) - _MOST} more"] if len(unsteady) > _MOST else []
    if told.few_views:
        lines.append(f"objects that hardly any view shows: {', '.join(map(str, told.few_views))}")
    if not (told.findings or told.damage or unsteady or told.few_views):
        lines.append("nothing is wrong with it.")
    return "\n".join(lines) + "\n"


def _depth(told: Inspection) -> str:
    if told.depth is None:
        return "none"
    middle = "" if told.depth.median_m is None else f", {told.depth.median_m:.2f} m in the median"
    return f"{told.depth.kind}, {100 * told.depth.covered:.0f} % of pixels{middle}"


def _unit(told: Inspection) -> str:
    if told.metric:
        return "metre" if told.units_per_metre == 1.0 else f"1/{told.units_per_metre:g} m"
    return f"unknown; guessed {told.units_per_metre:.3g} units a metre"


def _up(told: Inspection) -> str:
    """The nearest axis, and how far off it is."""
    up = np.array(told.up)
    axis = int(np.abs(up).argmax())
    degrees = float(np.degrees(np.arccos(min(1.0, abs(up[axis]) / max(float(np.linalg.norm(up)), 1e-9)))))
    return f"{'+' if up[axis] > 0 else '-'}{'xyz'[axis]}, {degrees:.0f}° off"
