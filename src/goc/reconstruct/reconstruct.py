"""Stage 2: Capture → Reconstruction."""

from pathlib import Path

import torch
from jaxtyping import Int16
from torch import Tensor

from goc.device import CPU, one_torch_thread
from goc.errors import ReconstructError
from goc.events import Listener, Warned, ignore
from goc.raster import NATIVE, Engine
from goc.reconstruct.config import ReconstructConfig
from goc.reconstruct.geometry_prior import geometry_priors
from goc.reconstruct.labels import capture_ids, classified_views, feature_width, new_classifier, vote_labels
from goc.reconstruct.measure import measure
from goc.reconstruct.monocular import ALIGNMENT, aligned_capture, alignment_of
from goc.reconstruct.optimise import optimise
from goc.reconstruct.pairs import Pairs, view_pairs
from goc.reconstruct.seed import seed, splat_budget
from goc.reconstruct.state import State, initial_state
from goc.reconstruct.task import Task
from goc.scene.capture import UNLABELLED, Capture
from goc.scene.gaussians import Gaussians
from goc.scene.reconstruction import Reconstruction

_MIN_VIEWS_TO_HOLD_OUT = 20


def reconstruct(
    capture: Capture,
    config: ReconstructConfig,
    notify: Listener = ignore,
    checkpoint: Path | None = None,
    resume: bool = False,
    engine: Engine = NATIVE,
) -> Reconstruction:
    """Optimise labelled Gaussians that show what the capture shows (paper §4).

    Args:
        capture: posed views; depth, ids and priors are used where there are any.
        config: steps, losses, rates, budget.
        notify: hears Progress with the running PSNR and the number of splats.
        checkpoint: file that keeps the state every `config.checkpoint_every` steps.
        resume: continue from that file; bit-equal to an uninterrupted run on a CPU.
        engine: what draws. What comes out is on the processor.

    Raises:
        ReconstructError: fewer than two views, nothing to start from, or a loss that is not finite.
    """
    with one_torch_thread():
        task = _task(capture, config, notify, engine)
        return _reconstruct(task, notify, checkpoint, resume)


def _task(capture: Capture, config: ReconstructConfig, notify: Listener, engine: Engine) -> Task:
    train, _ = split_views(len(capture), config.holdout_every)
    if len(train) < 2:
        raise ReconstructError(f"{len(train)} training view(s): reconstruction needs at least 2.")
    learned = config.labels == "learned" and capture.has_ids
    if config.labels == "learned" and not capture.has_ids:
        notify(Warned(stage="reconstruct", message="labels = learned needs ids; this capture has none"))
    return Task(
        capture=capture,
        views=train,
        names=capture_ids(capture, train) if learned else [],
        extent=_extent(capture),
        budget=splat_budget(capture, config),
        pairs=_pairs(capture, train, config, notify),
        prior=geometry_priors(capture, config.losses.depth_normal > 0, config.losses.monocular),
        config=config,
        engine=engine,
    )


def _reconstruct(task: Task, notify: Listener, checkpoint: Path | None, resume: bool) -> Reconstruction:
    capture, config, train = task.capture, task.config, task.views
    _, held_out = split_views(len(capture), config.holdout_every)

    def begin() -> State:
        seen, remembered = _aligned(capture)
        gaussians = seed(seen, train, config)
        state = _with_features(gaussians, task) if task.names else initial_state(gaussians, {})
        state.views |= remembered
        return state

    state = optimise(task, begin, notify, checkpoint, resume)
    gaussians = state.gaussians().detached()
    metrics = {"iterations": float(config.iterations), "splats": float(len(gaussians))}
    if capture.alignment is not None:
        metrics |= capture.alignment.metrics
    metrics |= measure(gaussians, capture, held_out, "held_out", notify)
    if not held_out:
        metrics |= measure(gaussians, capture, train[:: max(1, len(train) // 10)], "train", notify)
    labels = _labels(state, gaussians, task, notify)
    return Reconstruction(gaussians=gaussians.to(CPU), labels=labels, metrics=metrics)


def _pairs(capture: Capture, train: list[int], config: ReconstructConfig, notify: Listener) -> Pairs | None:
    pairs = view_pairs(capture, train, config)
    if pairs is not None and not any(pairs.neighbours.values()):
        flags = "--reconstruct.losses.multiview.max-*"
        message = f"none of {len(train)} views has a neighbour to be compared with: raise {flags}"
        notify(Warned(stage="reconstruct", message=message))
        return None
    return pairs


def _aligned(capture: Capture) -> tuple[Capture, dict[str, Tensor]]:
    """The capture with depth to seed from, and what is to be remembered of its views."""
    if not capture.has_depth or capture.has_metric_depth:
        return capture, {}
    rows = alignment_of(capture)
    return aligned_capture(capture, rows), {ALIGNMENT: rows.clone()}


def split_views(count: int, holdout_every: int) -> tuple[list[int], list[int]]:
    """Training and held-out views: every n-th, from the middle of each run of n; none of a capture of few views."""
    if holdout_every <= 0 or count < _MIN_VIEWS_TO_HOLD_OUT:
        return list(range(count)), []
    held_out = range(holdout_every // 2, count, holdout_every)
    return [view for view in range(count) if view not in held_out], list(held_out)


def _extent(capture: Capture) -> float:
    """Radius of the camera positions round their middle times 1.1, as 3DGS scales its steps; at least half a metre."""
    positions = torch.stack([camera.position for camera in capture.cameras])
    radius = (positions - positions.mean(0)).norm(dim=-1).max().item()
    return max(1.1 * radius, 0.5 * capture.units_per_metre)


def _with_features(gaussians: Gaussians, task: Task) -> State:
    generator = torch.Generator().manual_seed(task.config.seed)
    width = feature_width(task.config.depth == "plane")
    features = torch.randn(len(gaussians), width, generator=generator) * 0.1
    state = initial_state(gaussians, new_classifier(len(task.names), width, generator))
    state.parameters["identity"] = features.requires_grad_()
    state.first["identity"], state.second["identity"] = torch.zeros_like(features), torch.zeros_like(features)
    return state


def _labels(state: State, gaussians: Gaussians, task: Task, notify: Listener) -> Int16[Tensor, "n"]:
    if not task.capture.has_ids:
        return torch.full((len(gaussians),), UNLABELLED, dtype=torch.int16)
    if not task.names:
        return vote_labels(gaussians, task.capture, task.views, notify)
    shown = classified_views(gaussians, state.shared, task.names, task.capture)
    return vote_labels(gaussians, shown, task.views, notify)
