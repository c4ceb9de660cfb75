"""Capture in, Capture out: its cameras and photographs as its views agree on them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import msgspec
import numpy as np
import torch
from jaxtyping import Bool, Float64
from scipy.spatial.transform import Rotation

from goc.align.config import AlignConfig
from goc.align.corrected import CorrectedFrames, corrected_cameras
from goc.align.exposure import channel_looks, exposures
from goc.align.images import AlignedView, Samples, coarse_views, samples_of
from goc.align.pairs import compared_views
from goc.align.system import Given, Look, compare, moved
from goc.device import one_torch_thread
from goc.events import Listener, Progress, ignore
from goc.scene.capture import Alignment, Capture

_STAGE = "align"
_OTHERS = 8
"""Views that each one is compared with."""
_ACROSS, _FIRST_ACROSS = 52, 26
"""Points that are compared, across and down a view, and how many where it is only looked whether views agree."""
_BLURS = (4.0, 4.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0)
"""Blur of the photographs in each round, pixels of an image that is 320 wide: fine detail leads only from near."""
_REACH_M = (0.08, 0.06, 0.05, 0.05, 0.04, 0.04, 0.04, 0.04)
_FIRST_GAP_M = 0.01
_FEWEST = 2
"""Views with depth that can disagree."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Views:
    """All views of a capture, as alignment sees them."""

    images: list[AlignedView | None]
    poses: Float64[np.ndarray, "v 4 4"]
    typical: float
    unit: float
    train: Bool[np.ndarray, "v"]
    """Which views may be looked at; the others are held out."""

    def samples(self, across: int, which: Bool[np.ndarray, "v"]) -> list[Samples | None]:
        """Points of some views."""
        chosen = zip(self.images, which, strict=True)
        return [None if view is None or not on else samples_of(view, across) for view, on in chosen]

    def look(self, round_: int, gap: float) -> Look:
        """How a round compares; `gap` in scene units."""
        return Look(blur_px=_BLURS[round_], reach=_REACH_M[round_] * self.unit, gap=gap, typical=self.typical)


def align(
    capture: Capture, config: AlignConfig, train: Sequence[int] | None = None, notify: Listener = ignore
) -> Capture:
    """Correct cameras and photographs where views do not agree with each other; see docs/decisions/0046.

    Cameras move so that depth lies on the surface that other views measure, and photographs show there what others
    show: Gauss-Newton over all pairs of views. They are held to the given ones, whose mean stays.

    Args:
        capture: with metric depth; another one is handed on as it is.
        config: what may be corrected.
        train: views that are not held out; all if None. The others follow without a say.
        notify: hears progress, and a warning of what was found.

    Returns:
        The capture with corrected cameras and photographs, and its `alignment`, which tells what was found.
    """
    if config.poses == config.exposure == "off" or not capture.has_metric_depth:
        return capture
    with one_torch_thread():
        return _aligned(capture, config, train, notify)


def _aligned(capture: Capture, config: AlignConfig, train: Sequence[int] | None, notify: Listener) -> Capture:
    views = _views(capture, train)
    known = np.array([view is not None for view in views.images])
    if (known & views.train).sum() < _FEWEST:
        return capture
    others = compared_views(views.images, views.poses, _OTHERS, views.train & known)
    look = views.look(0, _FIRST_GAP_M * views.unit)
    found = compare(views.images, views.samples(_FIRST_ACROSS, views.train), others, views.poses, look)
    given = Given(
        poses=views.poses,
        position=config.position_m * views.unit,
        angle=np.radians(config.angle_deg),
        fixed=(~views.train).astype(float),
    )
    metrics = _disagreement(views, moved(views.poses, found, given))
    wanted = config.poses == "on" or (
        config.poses == "auto"
        and (metrics["pose_disagreement_m"] > config.least_m or metrics["pose_disagreement_deg"] > config.least_deg)
    )
    poses = views.poses
    if wanted:
        poses, told = _fitted(views, others, given, found.mean_gap, notify)
        metrics |= told
    exposure, gains = _exposure(views, others, poses, config)
    metrics |= gains
    return _corrected(capture, config, poses if wanted else None, exposure, metrics)


def _views(capture: Capture, train: Sequence[int] | None) -> _Views:
    images = coarse_views(capture, list(range(len(capture))))
    on = np.zeros(len(capture), bool)
    on[list(range(len(capture)) if train is None else train)] = True
    depths = [float(np.nanmedian(view.depth)) for view in images if view is not None and np.isfinite(view.depth).any()]
    return _Views(
        images=images,
        poses=np.stack([camera.world_from_cam.double().numpy() for camera in capture.cameras]),
        typical=float(np.median(depths)) if depths else 1.0,
        unit=capture.units_per_metre,
        train=on,
    )


def _fitted(
    views: _Views, others: list[list[int]], given: Given, gap: float, notify: Listener
) -> tuple[Float64[np.ndarray, "v 4 4"], dict[str, float]]:
    """Poses after all rounds, held-out views last, and what became better."""
    samples, poses, last = views.samples(_ACROSS, views.train), views.poses, len(_BLURS) - 1
    before = compare(views.images, samples, others, poses, views.look(last, gap))
    for number in range(len(_BLURS)):
        found = compare(views.images, samples, others, poses, views.look(number, gap))
        poses = _centred(moved(poses, found, given), given)
        gap = 1.25 * found.mean_gap
        notify(Progress(stage=_STAGE, done=number + 1, total=len(_BLURS) + 1))
    after = compare(views.images, samples, others, poses, views.look(last, gap))
    rest = ~views.train
    if rest.any():
        follow, samples = replace(given, fixed=(~rest).astype(float)), views.samples(_ACROSS, rest)
        for number in range(len(_BLURS)):
            found = compare(views.images, samples, others, poses, views.look(number, gap))
            poses = moved(poses, found, follow)
    notify(Progress(stage=_STAGE, done=len(_BLURS) + 1, total=len(_BLURS) + 1))
    told = {
        "depth_gap_before_m": before.mean_gap / views.unit,
        "depth_gap_after_m": after.mean_gap / views.unit,
        "photo_difference_before": before.mean_difference,
        "photo_difference_after": after.mean_difference,
    }
    shifts, turns = _apart(views.poses, poses)
    return poses, told | {
        "pose_moved_m": float(np.median(shifts)) / views.unit,
        "pose_moved_deg": float(np.median(turns)),
    }


def _centred(poses: Float64[np.ndarray, "v 4 4"], given: Given) -> Float64[np.ndarray, "v 4 4"]:
    """All cameras moved together, so that corrections have no mean: pairs do not see where all of them are."""
    free = given.fixed == 0
    turns = Rotation.from_matrix(given.poses[free, :3, :3] @ poses[free, :3, :3].transpose(0, 2, 1))
    back = turns.mean().as_matrix()
    middle, goal = poses[free, :3, 3].mean(0), given.poses[free, :3, 3].mean(0)
    out = poses.copy()
    out[free, :3, :3] = back @ poses[free, :3, :3]
    out[free, :3, 3] = (poses[free, :3, 3] - middle) @ back.T + goal
    return out


def _apart(
    a: Float64[np.ndarray, "v 4 4"], b: Float64[np.ndarray, "v 4 4"]
) -> tuple[Float64[np.ndarray, "v"], Float64[np.ndarray, "v"]]:
    """Distances of positions, and angles between directions in degrees."""
    turns = Rotation.from_matrix(a[:, :3, :3] @ b[:, :3, :3].transpose(0, 2, 1)).magnitude()
    return np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1), np.degrees(turns)


def _disagreement(views: _Views, poses: Float64[np.ndarray, "v 4 4"]) -> dict[str, float]:
    """How far cameras would move to fit the others, median of the views that may be looked at."""
    shifts, turns = _apart(views.poses[views.train], poses[views.train])
    return {
        "pose_disagreement_m": float(np.median(shifts)) / views.unit,
        "pose_disagreement_deg": float(np.median(turns)),
    }


def _exposure(
    views: _Views, others: list[list[int]], poses: Float64[np.ndarray, "v 4 4"], config: AlignConfig
) -> tuple[Float64[np.ndarray, "v 3 2"] | None, dict[str, float]]:
    """Gain and offset of all photographs where they differ, and by how much they do."""
    if config.exposure == "off":
        return None, {}
    everyone = np.ones(len(poses), bool)
    look, samples = views.look(len(_BLURS) - 1, _FIRST_GAP_M * views.unit), views.samples(_FIRST_ACROSS, everyone)
    sums = [compare(views.images, samples, others, poses, one) for one in channel_looks(look)]
    found = exposures(sums, len(poses))
    spread = float(np.log(found[views.train, :, 0]).std())
    on = config.exposure == "on" or spread > config.least_gain
    return (found if on else None), {"exposure_spread": spread}


def _corrected(
    capture: Capture,
    config: AlignConfig,
    poses: Float64[np.ndarray, "v 4 4"] | None,
    exposure: Float64[np.ndarray, "v 3 2"] | None,
    metrics: dict[str, float],
) -> Capture:
    """The capture with what was corrected, or as it was where nothing is."""
    cameras = capture.cameras if poses is None else corrected_cameras(capture.cameras, poses)
    gains = None if exposure is None else torch.from_numpy(exposure)
    alignment = Alignment(
        cameras=capture.cameras,
        frames=capture.frames,
        moved=poses is not None,
        exposure=gains,
        metrics=metrics,
        settings=msgspec.json.encode(asdict(config), order="sorted").decode(),
    )
    if poses is None and exposure is None:
        return replace(capture, alignment=alignment)
    frames = CorrectedFrames(below=capture.frames, cameras=cameras, exposure=gains)
    return replace(capture, cameras=cameras, frames=frames, alignment=alignment)
