"""Cameras that fit each other: rounds of Gauss-Newton, and how far they are from fitting."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from goc.align.exposure import channel_looks, exposures
from goc.align.system import Given, compare, moved
from goc.align.views import BLURS, FIRST_GAP_M, ViewSet
from goc.events import Listener, Progress

_LAST = len(BLURS) - 1
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
    """How far cameras would move in one coarse step, medians, and how much the gains of photographs differ."""
    found = compare(
        views.images, views.samples(0, views.train), views.others, given.poses, views.look(0, _first(views))
    )
    shifts, turns = apart(views.poses[views.train], moved(given.poses, found, given)[views.train])
    gains = evened_gains(views, given.poses, 0)
    return {
        "pose_disagreement_m": float(np.median(shifts)) / views.unit,
        "pose_disagreement_deg": float(np.median(turns)),
        "exposure_spread": float(np.log(gains[views.train, :, 0]).std()),
    }


def evened_gains(views: ViewSet, poses: Poses, round_: int = _LAST) -> Float64[np.ndarray, "v 3 2"]:
    """Gain and offset of each channel of all photographs."""
    look, everyone = views.look(round_, _first(views)), np.ones(len(poses), bool)
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
