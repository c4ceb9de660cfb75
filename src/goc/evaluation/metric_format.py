"""Titles, units and digits of all metrics, for the terminal and for the page."""

from collections.abc import Mapping
from dataclasses import dataclass

from goc.evaluation.result import Evaluation, Figures

NOTHING = "–"


@dataclass(frozen=True, kw_only=True)
class MetricFormat:
    """How one metric is shown: its column's title, unit, digits and meaning."""

    title: str
    unit: str
    """Shown after the title; lengths are shown in mm, volumes in litres."""
    scale: float
    digits: int
    meaning: str
    less_is_better: bool

    def shown(self, value: float | None) -> str:
        """A value as text."""
        return NOTHING if value is None else f"{value * self.scale:,.{self.digits}f}"


def _share(title: str, meaning: str) -> MetricFormat:
    return MetricFormat(title=title, unit="", scale=1.0, digits=3, meaning=meaning, less_is_better=False)


def _length(title: str, meaning: str) -> MetricFormat:
    return MetricFormat(title=title, unit="mm", scale=1e3, digits=1, meaning=meaning, less_is_better=True)


def _volume(title: str, meaning: str) -> MetricFormat:
    return MetricFormat(title=title, unit="l", scale=1e3, digits=2, meaning=meaning, less_is_better=True)


METRICS: Mapping[str, MetricFormat] = {
    "f_score_0.05": _share("F 5 cm", "harmonic mean of precision and recall at 5 cm"),
    "f_score_0.01": _share("F 1 cm", "harmonic mean of precision and recall at 1 cm"),
    "accuracy": _length("Acc", "mean distance from the predicted surface to the true one"),
    "completion": _length("Comp", "mean distance from the true surface to the predicted one"),
    "chamfer": _length("CD", "mean of accuracy and completion"),
    "accuracy_seen": _length("Acc seen", "accuracy where the nearest true surface was seen by some camera"),
    "accuracy_unseen": _length("Acc unseen", "accuracy where it was seen by none"),
    "completion_seen": _length("Comp seen", "completion of true surface that some camera saw"),
    "completion_unseen": _length("Comp unseen", "completion of true surface that none saw"),
    "normal_consistency": _share("NC", "mean |cos| between normals of nearest samples"),
    "label_accuracy": _share("Label acc", "share of the predicted surface that is nearest to its own object"),
    "label_recall": _share("Label recall", "share of the seen true surface that its own prediction shows within 2 cm"),
    "watertight": _share("Watertight", "share of objects whose mesh is closed and well formed"),
    "iou": _share("IoU", "volume in both over volume in either; 0 where the prediction is missing or open"),
    "volume_relative_error": MetricFormat(
        title="Volume error",
        unit="%",
        scale=100.0,
        digits=1,
        meaning="of a watertight prediction, relative to the true volume",
        less_is_better=True,
    ),
    "bottom_error": _length("Bottom", "distance in height of the lowest points of prediction and truth"),
    "bottom": _length("Bottom above", "height of the prediction's lowest point above the truth's"),
    "volume_ratio": MetricFormat(
        title="Volume ratio",
        unit="",
        scale=1.0,
        digits=2,
        meaning="of a watertight prediction, volume over true volume",
        less_is_better=True,
    ),
    "volume": _volume("Volume", "of a watertight prediction"),
    "volume_truth": _volume("True volume", "of the true solid"),
    "volume_error": _volume("Volume off by", "absolute difference of the volumes"),
    "self_intersections": MetricFormat(
        title="Self-cuts",
        unit="",
        scale=1.0,
        digits=1,
        meaning="pairs of the mesh's own triangles that cut each other",
        less_is_better=True,
    ),
    "penetration_depth": _length("Into others", "greatest depth in a neighbour"),
    "penetration_volume": _volume("Shared", "volume shared with neighbours"),
    "room_depth": _length("Into room", "greatest depth in the walls, the floor or the ceiling"),
    "room_volume": _volume("In room", "volume in the walls, the floor or the ceiling"),
    "precision_0.05": _share("Prec 5 cm", "share of the predicted surface within 5 cm of the truth"),
    "recall_0.05": _share("Recall 5 cm", "share of the true surface within 5 cm of the prediction"),
    "precision_0.01": _share("Prec 1 cm", "share of the predicted surface within 1 cm of the truth"),
    "recall_0.01": _share("Recall 1 cm", "share of the true surface within 1 cm of the prediction"),
}
"""Every figure of any protocol, in the order of display."""

_DETAIL = ("precision", "recall", "volume", "volume_truth", "volume_error", "volume_ratio", "bottom")


def table_columns(evaluation: Evaluation) -> list[str]:
    """Figures that some object has, without those that only explain others; IoU only where some mesh is closed."""
    rows: list[Figures] = [item.figures for item in evaluation.objects.values()]
    present = [name for name in METRICS if any(row.get(name) is not None for row in rows)]
    if evaluation.counts.watertight == 0:
        present = [name for name in present if name not in ("iou", "watertight")]
    return [name for name in present if name not in _DETAIL and not name.startswith(("precision", "recall"))]


def summary_sentence(evaluation: Evaluation) -> str:
    """One sentence with the numbers of objects found, missing, extra, skipped and watertight."""
    counts = evaluation.counts
    words = [f"{counts.found} of {counts.objects} objects found"]
    words += [f"missing: {', '.join(map(str, evaluation.missing))}"] if evaluation.missing else []
    words += [f"{counts.extra} extra"] if counts.extra else []
    words += [f"{counts.skipped} skipped by the protocol"] if counts.skipped else []
    words += [f"{counts.watertight} watertight"]
    words += [f"deepest {METRICS[name].title.lower()} {_in_mm(value)}" for name, value in evaluation.deepest.items()]
    return "; ".join(words) + "."


def _in_mm(value: float | None) -> str:
    return NOTHING if value is None else f"{value * 1e3:,.1f} mm"
