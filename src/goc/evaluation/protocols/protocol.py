"""Input and output of every protocol, and means over its figures."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from goc.evaluation.metrics import SurfaceScores
from goc.evaluation.prediction import Prediction
from goc.evaluation.result import Figures
from goc.evaluation.truth import Truth

_NO_MEAN = ("volume", "volume_truth", "volume_error", "volume_ratio", "bottom")
"""Figures that are not averaged: a mean over a sofa and a cup says nothing, and signs cancel."""

_CONTACT = ("penetration_depth", "room_depth", "bottom_error")

Settings = dict[str, float | int | str | list[float]]


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedRun:
    """A run and a ground truth with their objects matched: the input of every protocol."""

    truth: Truth
    prediction: Prediction
    matches: Mapping[int, int]
    """Predicted id of each true id that has one."""
    extra: tuple[int, ...]
    """Predicted ids that match nothing."""
    seed: int


@dataclass(frozen=True, kw_only=True, eq=False)
class ProtocolResult:
    """The figures of each object and of the scene that a protocol found; NaN and infinity where undefined."""

    objects: dict[int, dict[str, float]]
    scene: dict[str, float] | None
    settings: Settings
    skipped: dict[int, str] = field(default_factory=dict)
    """Objects that the protocol leaves out of its means, and why."""


def surface_figures(scores: SurfaceScores, with_split: bool = True) -> dict[str, float]:
    """Scores under the names of eval.json."""
    names = ["accuracy", "completion", "chamfer", "normal_consistency"]
    if with_split:
        names += ["accuracy_seen", "accuracy_unseen", "completion_seen", "completion_unseen"]
    figures = {name: getattr(scores, name) for name in names}
    for threshold in scores.f_score:
        figures[f"f_score_{threshold:g}"] = scores.f_score[threshold]
        figures[f"precision_{threshold:g}"] = scores.precision[threshold]
        figures[f"recall_{threshold:g}"] = scores.recall[threshold]
    return figures


def means(objects: Iterable[Mapping[str, float]]) -> tuple[Figures, dict[str, int]]:
    """Mean of each figure over the objects in which it is finite, and how many those are."""
    rows = list(objects)
    mean: Figures = {}
    over: dict[str, int] = {}
    for name in dict.fromkeys(name for row in rows for name in row if name not in _NO_MEAN):
        values = [row[name] for row in rows if name in row and np.isfinite(row[name])]
        mean[name] = float(np.mean(values)) if values else None
        over[name] = len(values)
    return mean, over


def deepest(objects: Iterable[Mapping[str, float]]) -> Figures:
    """The greatest of each figure of contact over the objects that have it."""
    rows = list(objects)
    found: Figures = {}
    for name in _CONTACT:
        values = [row[name] for row in rows if name in row and np.isfinite(row[name])]
        found |= {name: float(max(values))} if values else {}
    return found


def finite(figures: Mapping[str, float]) -> Figures:
    """Figures with None for what is not finite, as JSON has it."""
    return {name: float(value) if np.isfinite(value) else None for name, value in figures.items()}
