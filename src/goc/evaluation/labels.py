"""Scores whether surfaces carry the right id, separately from whether they lie in the right place.

Where two true objects (or one and the room) meet, the right id of a point is ambiguous: surface within 1 cm of both is
not counted. Distances are exact, to triangles.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Bool, Float64

from goc.geometry.raycast import TriangleScene

AMBIGUOUS_WITHIN = 0.01
"""Surface this near to two ids may carry either, metres."""
RECALL_WITHIN = 0.02
"""True surface is found where the prediction comes this near, metres."""

Points = Float64[np.ndarray, "n 3"]


def label_accuracy(points: Points, id: int, truth: Mapping[int, TriangleScene]) -> float:
    """Share of an object's predicted surface that is nearest to the true surface of its own id, of all ids.

    Args:
        points: area-uniform samples of the prediction.
        id: true id that it is compared with.
        truth: true surface of each id, the room among them.

    Returns:
        0 to 1; NaN where every sample is ambiguous.
    """
    own, _ = truth[id].nearest(points)
    other = _nearest_of((scene for key, scene in truth.items() if key != id), points, _at_least(own))
    clear = ~((own <= AMBIGUOUS_WITHIN) & (other <= AMBIGUOUS_WITHIN))
    return _share(own <= other, clear)


def label_recall(
    points: Points, id: int, truth: Mapping[int, TriangleScene], predicted: Mapping[int, TriangleScene]
) -> float:
    """Share of an object's seen surface that a predicted surface within 2 cm shows, the nearest being its own.

    Args:
        points: samples of the true surface that some view saw.
        id: its id.
        truth: true surface of each id, the room among them.
        predicted: predicted surface of each object, by the true id it is compared with; others under ids of their own.

    Returns:
        0 to 1; NaN where every sample is ambiguous or none was seen.
    """
    others = (scene for key, scene in truth.items() if key != id)
    clear = np.isinf(_nearest_of(others, points, np.full(len(points), AMBIGUOUS_WITHIN)))
    if id not in predicted:
        return _share(np.zeros(len(points), bool), clear)
    own, _ = predicted[id].nearest(points, RECALL_WITHIN)
    other_predictions = (scene for key, scene in predicted.items() if key != id)
    other = _nearest_of(other_predictions, points, np.minimum(own, RECALL_WITHIN))
    return _share((own <= RECALL_WITHIN) & (own <= other), clear)


def nearest_id(points: Points, truth: Mapping[int, TriangleScene]) -> int:
    """The id whose true surface most of the points are nearest to."""
    distances = np.stack([scene.nearest(points)[0] for scene in truth.values()])
    return list(truth)[int(np.bincount(distances.argmin(axis=0)).argmax())]


def _nearest_of(
    scenes: Iterable[TriangleScene], points: Points, limit: Float64[np.ndarray, "n"]
) -> Float64[np.ndarray, "n"]:
    """Distance to the nearest of several surfaces, infinite beyond each point's limit."""
    best = np.full(len(points), np.inf)
    for scene in scenes:
        best = np.minimum(best, scene.nearest(points, np.minimum(best, limit))[0])
    return best


def _at_least(distances: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "n"]:
    return np.maximum(distances, AMBIGUOUS_WITHIN)


def _share(right: Bool[np.ndarray, "n"], counted: Bool[np.ndarray, "n"]) -> float:
    return float(right[counted].mean()) if counted.any() else float("nan")
