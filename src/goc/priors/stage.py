"""Stage 1b, Capture → Capture: what photographs and stored depth say of the surface before there are splats."""

from collections.abc import Sequence
from dataclasses import asdict, replace

import msgspec
from jaxtyping import Float
from torch import Tensor

from goc.device import one_torch_thread
from goc.events import Listener, ignore
from goc.priors.bend import bend
from goc.priors.config import PriorsConfig
from goc.priors.monocular import align_views
from goc.priors.stereo import stereo_depths
from goc.scene.capture import Capture
from goc.scene.priors import CapturePriors, CoarseDepth


def add_priors(
    capture: Capture, config: PriorsConfig, notify: Listener = ignore, views: Sequence[int] | None = None
) -> Capture:
    """Match photographs where depth and points are few, and align depth of unknown scale with what is known.

    Args:
        capture: one with metric depth, or of a single view, is handed on as it is.
        config: settings of stereo and of the alignment.
        notify: hears Progress, and Warned of depth that agrees with nothing known.
        views: which are looked at, such as those that are not held out; all if None.

    Returns:
        The capture with its `priors`; its frames stay as they were stored.
    """
    chosen = list(range(len(capture)) if views is None else views)
    if capture.has_metric_depth or len(chosen) < 2:
        return capture
    points = 0 if capture.points is None else len(capture.points.positions)
    with one_torch_thread():
        stereo = stereo_depths(capture, chosen, config.stereo, notify) if points < config.fewest_points else None
        alignment = _alignment(capture, chosen, stereo or {}, config, notify) if capture.has_depth else None
    settings = msgspec.json.encode(asdict(config), order="sorted").decode()
    return replace(capture, priors=CapturePriors(stereo=stereo, alignment=alignment, settings=settings))


def _alignment(
    capture: Capture, views: list[int], stereo: dict[int, CoarseDepth], config: PriorsConfig, notify: Listener
) -> Float[Tensor, "n r"]:
    rows = align_views(capture, views, stereo, notify)
    return bend(capture, views, rows, notify) if config.bend else rows
