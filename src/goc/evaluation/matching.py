"""Matches predicted objects with true ones, by id or by shape."""

from collections.abc import Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from goc.evaluation.metrics import sample_surface
from goc.evaluation.rooms import has_surface
from goc.evaluation.truth import Truth
from goc.scene import Mesh

_SAMPLES = 4_000
_WITHIN = 0.05
_LEAST = 0.1
"""Pairs with a lower F-score are not matched: they merely stand near each other."""


def match_by_id(predicted: Mapping[int, Mesh], truth: Truth) -> dict[int, int]:
    """Predicted id of each true id that is there and has any surface."""
    return {id: id for id in truth.objects if id in predicted and has_surface(predicted[id])}


def match_by_shape(predicted: Mapping[int, Mesh], truth: Truth, seed: int) -> dict[int, int]:
    """The one-to-one assignment with the greatest sum of F at 5 cm; pairs below 0.1 stay apart.

    Returns:
        Predicted id by true id.
    """
    names = [id for id in predicted if has_surface(predicted[id])]
    if not names:
        return {}
    clouds = [sample_surface(predicted[id], _SAMPLES, seed).points for id in names]
    # Samples of the truth come in no particular order: every n-th are as good as any.
    truths = [item.samples.points[:: max(1, len(item.samples) // _SAMPLES)] for item in truth.objects.values()]
    trees, true_trees = [cKDTree(cloud) for cloud in clouds], [cKDTree(cloud) for cloud in truths]
    scores = np.zeros((len(truths), len(names)))
    for row, true_tree in enumerate(true_trees):
        for column, tree in enumerate(trees):
            scores[row, column] = _overlap(true_tree, tree)
    rows, columns = linear_sum_assignment(scores, maximize=True)
    ids = list(truth.objects)
    return {ids[r]: names[c] for r, c in zip(rows, columns, strict=True) if scores[r, c] >= _LEAST}


def _overlap(first: cKDTree, second: cKDTree) -> float:
    """F at 5 cm of two clouds."""
    if (first.mins > second.maxes + _WITHIN).any() or (second.mins > first.maxes + _WITHIN).any():
        return 0.0
    shares = [
        float((b.query(a.data, distance_upper_bound=_WITHIN)[0] < _WITHIN).mean())
        for a, b in ((first, second), (second, first))
    ]
    return 2 * shares[0] * shares[1] / sum(shares) if sum(shares) > 0 else 0.0
