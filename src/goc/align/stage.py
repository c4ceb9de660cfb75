"""Capture in, Capture out: its cameras and photographs as its views agree on them."""

from collections.abc import Sequence
from dataclasses import asdict, replace

import msgspec
import numpy as np
import torch
from jaxtyping import Float64

from goc.align.config import AlignConfig
from goc.align.corrected import CorrectedFrames, corrected_cameras
from goc.align.fit import disagreement, evened_gains, fitted
from goc.align.images import AlignedView
from goc.align.system import Given
from goc.align.views import ViewSet, view_set
from goc.device import one_torch_thread
from goc.events import Listener, Warned, ignore
from goc.scene.capture import Alignment, Capture

_LOOKED_AT = 40
"""Views that tell whether a capture needs correction: an exact one pays for no more."""
_FEWEST = 2
"""Views with depth that can disagree."""


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
        notify: hears progress, and a warning where cameras could not be made to agree better.

    Returns:
        The capture with corrected cameras and photographs, and its `alignment`, which tells what was found.
    """
    if config.poses == config.exposure == "off" or not capture.has_metric_depth:
        return capture
    with one_torch_thread():
        return _aligned(capture, config, list(range(len(capture)) if train is None else train), notify)


def _aligned(capture: Capture, config: AlignConfig, train: list[int], notify: Listener) -> Capture:
    few = train[:: -(-len(train) // _LOOKED_AT)]
    images: dict[int, AlignedView | None] = {}
    views = view_set(capture, few, np.ones(len(few), bool), images)
    if sum(view is not None for view in views.images) < _FEWEST:
        return capture
    metrics = disagreement(views, _given(views, config))
    off = metrics["pose_disagreement_m"] > config.least_m or metrics["pose_disagreement_deg"] > config.least_deg
    move = config.poses == "on" or (config.poses == "auto" and off)
    even = config.exposure == "on" or (
        config.exposure == "auto" and metrics["exposure_disagreement"] > config.least_brightness
    )
    poses = gains = None
    if move or even:
        on = np.zeros(len(capture), bool)
        on[train] = True
        views = view_set(capture, range(len(capture)), on, images)
    if move:
        poses, told = _moved(views, config, notify)
        metrics |= told
    if even:
        gains = evened_gains(views, views.poses if poses is None else poses)
    return _corrected(capture, config, poses, gains, metrics)


def _given(views: ViewSet, config: AlignConfig) -> Given:
    return Given(
        poses=views.poses,
        position=config.position_m * views.unit,
        angle=np.radians(config.angle_deg),
        fixed=(~views.train).astype(float),
    )


def _moved(
    views: ViewSet, config: AlignConfig, notify: Listener
) -> tuple[Float64[np.ndarray, "v 4 4"] | None, dict[str, float]]:
    found = fitted(views, _given(views, config), notify)
    if found.better:
        return found.poses, found.metrics
    message = "views disagree, but moving their cameras does not help: they stay. Check depth and intrinsics"
    notify(Warned(stage="align", message=message))
    return None, {}


def _corrected(
    capture: Capture,
    config: AlignConfig,
    poses: Float64[np.ndarray, "v 4 4"] | None,
    gains: Float64[np.ndarray, "v 3 2"] | None,
    metrics: dict[str, float],
) -> Capture:
    """The capture with what was corrected, or as it was where nothing is."""
    cameras = capture.cameras if poses is None else corrected_cameras(capture.cameras, poses)
    exposure = None if gains is None else torch.from_numpy(gains)
    alignment = Alignment(
        cameras=capture.cameras,
        frames=capture.frames,
        moved=poses is not None,
        exposure=exposure,
        metrics=metrics,
        settings=msgspec.json.encode(asdict(config), order="sorted").decode(),
    )
    if poses is None and exposure is None:
        return replace(capture, alignment=alignment)
    frames = CorrectedFrames(below=capture.frames, cameras=cameras, exposure=exposure)
    return replace(capture, cameras=cameras, frames=frames, alignment=alignment)
