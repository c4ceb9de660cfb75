"""Whole captures: benchmark rooms with true ids, and a real kitchen whose ids were drawn by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from goc.capture import load_capture
from goc.priors.segmentation import SegmentConfig, segment


def share_matched(folder: Path, step: int) -> float:
    """Share of the given objects that one found object overlaps by half (intersection over union of pixels)."""
    views = load_capture(folder)
    whole = views
    kept = range(0, len(views), step)
    views = replace(
        views,
        cameras=tuple(views.cameras[index] for index in kept),
        view_names=tuple(views.view_names[index] for index in kept),
        frames=lambda index: whole[kept[index]],
    )
    found = segment(views, SegmentConfig())
    a = np.concatenate([frame.ids.where(frame.depth.isfinite(), -1).numpy().ravel() for frame in views])
    b = np.concatenate([frame.ids.numpy().ravel() for frame in found])
    best = []
    for number in np.unique(a[a > 0]):
        inside = a == number
        others = [other for other in np.unique(b[inside]) if other > 0]
        best.append(
            max(((inside & (b == o)).sum() / (inside | ((b == o) & (a >= 0))).sum() for o in others), default=0)
        )
    return float(np.mean(np.array(best) >= 0.5))


@pytest.mark.data
@pytest.mark.parametrize(("name", "least"), [("bench/study", 0.9), ("real/redkitchen", 0.65)])
def test_most_objects_are_found(data_root, name, least):
    assert share_matched(data_root / name, 4) >= least
