"""Cameras that fit each other: rounds of Gauss-Newton, and how far they are from fitting."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from goc.align.exposure import brightness_apart, channel_looks, exposures
from goc.align.system import Given, Look, compare, moved
from goc.align.views import BLURS, FIRST_GAP_M, ViewSet
from goc.events import Listener, Progress

_LAST = len(BLURS) - 1
_HELPS = 0.95
"""Share of the gaps that a step has to leave at most, for cameras to be wrong: exact captures keep all, Kinect's .999,
and those with cameras 1 cm off .83 (training rooms 101 to 104)."""
Poses = Float64[np.ndarray, "v 4 4"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """Cameras after all rounds."""

    poses: Poses
    metrics: dict[str, float]
    """How well views agreed before and after, for the report."""
    better: bool
    """Whether depth or photographs agree better than with the given cameras."""


def disagreement(views: ViewSet, given: Given) -> dict[str, float]:
    """How far cameras would move in one coarse step, medians, and how much the brightness of photographs differs.

    Cameras would not move where that step brings depth no nearer, as in an exact capture: edges and curved surfaces
    pull a little, always.
    """
    samples, gap = views.samples(0, views.train), _first(views)
    looks = [compare(views.images, samples, views.others, given.poses, look) for look in _greys(views.look(0, gap))]
    poses = moved(given.poses, looks[0], given)
    after = compare(views.images, samples, views.others, poses, views.look(0, gap))
    shifts, turns = apart(views.poses[views.train], poses[views.train])
    helps = after.mean_gap < _HELPS * looks[0].mean_gap
    return {
        "pose_disagreement_m": float(np.median(shifts)) / views.unit if helps else 0.0,
        "pose_disagreement_deg": float(np.median(turns)) if helps else 0.0,
        "exposure_disagreement": max(brightness_apart(found) for found in looks[1:]),
    }


def _greys(look: Look) -> list[Look]:
    """A look at the mean of all channels, and at each."""
    return [look, *channel_looks(look)]


def evened_gains(views: ViewSet, poses: Poses) -> Float64[np.ndarray, "v 3 2"]:
    """Gain and offset of each channel of all photographs."""
    look, everyone = views.look(_LAST, _first(views)), np.ones(len(poses), bool)
    samples = views.samples(0, everyone)
    return exposures(
        [compare(views.images, samples, views.others, poses, one) for one in channel_looks(look)], len(poses)
    )


def fitted(views: ViewSet, given: Given, notify: Listener) -> Fitted:
    """Move the views that may be looked at until they agree, then the held-out ones after them."""
    gap, poses = _first(views), views.poses
    before = compare(views.images, views.samples(_LAST, views.train), views.others, poses, views.look(_LAST, gap))
    for number in range(len(BLURS)):
        samples = views.samples(number, views.train)
        found = compare(views.images, samples, views.others, poses, views.look(number, gap))
        poses = centred(moved(poses, found, given), given)
        gap = 1.25 * found.mean_gap
        notify(Progress(stage="align", done=number + 1, total=len(BLURS)))
    after = compare(views.images, views.samples(_LAST, views.train), views.others, poses, views.look(_LAST, gap))
    shifts, turns = apart(views.poses, poses)
    metrics = {
        "depth_gap_before_m": before.mean_gap / views.unit,
        "depth_gap_after_m": after.mean_gap / views.unit,
        "photo_difference_before": before.mean_difference,
        "photo_difference_after": after.mean_difference,
        "pose_moved_m": float(np.median(shifts[views.train])) / views.unit,
        "pose_moved_deg": float(np.median(turns[views.train])),
    }
    better = after.mean_gap < before.mean_gap or after.mean_difference < before.mean_difference
    return Fitted(poses=_followed(views, given, poses, gap), metrics=metrics, better=better)


def _followed(views: ViewSet, given: Given, poses: Poses, gap: float) -> Poses:
    """Held-out views moved to fit those that may be looked at, which stay."""
    rest = ~views.train
    if not rest.any():
        return poses
    follow = replace(given, fixed=views.train.astype(float))
    for number in range(0, len(BLURS), 2):
        found = compare(views.images, views.samples(number, rest), views.others, poses, views.look(number, gap))
        poses = moved(poses, found, follow)
    return poses


def centred(poses: Poses, given: Given) -> Poses:
    """All cameras moved together, so that corrections have no mean: pairs do not see where all of them are."""
    free = given.fixed == 0
    turns = Rotation.from_matrix(given.poses[free, :3, :3] @ poses[free, :3, :3].transpose(0, 2, 1))
    back = turns.mean().as_matrix()
    middle, goal = poses[free, :3, 3].mean(0), given.poses[free, :3, 3].mean(0)
    out = poses.copy()
    out[free, :3, :3] = back @ poses[free, :3, :3]
    out[free, :3, 3] = (poses[free, :3, 3] - middle) @ back.T + goal
    return out


def apart(a: Poses, b: Poses) -> tuple[Float64[np.ndarray, "v"], Float64[np.ndarray, "v"]]:
    """Distances of positions, and angles between directions in degrees."""
    turns = Rotation.from_matrix(a[:, :3, :3] @ b[:, :3, :3].transpose(0, 2, 1)).magnitude()
    return np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1), np.degrees(turns)


def _first(views: ViewSet) -> float:
    return FIRST_GAP_M * views.unit
