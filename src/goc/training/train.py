"""`goc osc train`: the training loop, on one process or several; it can be stopped and continued at any step."""

import hashlib
import math
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import torch
from torch import Tensor, distributed, nn

from goc.complete import LiteConfig, begin_from, build, save_network
from goc.errors import TrainError
from goc.events import Listener, Progress, ignore
from goc.files import is_file
from goc.training.config import TrainConfig
from goc.training.loader import BatchRecipe, batches
from goc.training.losses import completion_loss, hard_iou
from goc.training.procedural import random_shape
from goc.training.samples import TrainingBatch
from goc.training.state import TrainState, initial_state, load_state, save_state
from goc.training.thumbnails import tiled
from goc.training.tracker import Tracker
from goc.training.validation import ValidationCase, guess_network, preview, score, validation_cases
from goc.training.watertight_shape import WatertightShape

STATE, WEIGHTS = "state.safetensors", "weights.safetensors"
_CELLS_OF_POINTS = 8
"""Side of the evidence grid for networks that take points: they do not use it, so it is small."""
_VALIDATION_SHAPES = 24


@dataclass(frozen=True, kw_only=True)
class ProcessGroup:
    """Rank of the process among those that train together, and its device."""

    rank: int
    world: int
    device: torch.device


def train(out: Path, config: TrainConfig, notify: Listener = ignore) -> Path:
    """Train a completion network, or go on with it where `out` holds a stopped training of the same settings.

    Started by `torchrun --nproc-per-node N -m goc.cli osc train …` it runs on N processes, and gradients are means
    over them.

    Args:
        out: folder for state.safetensors, weights.safetensors (running mean), curves and pictures.
        config: everything else.
        notify: hears progress.

    Returns:
        The weights' path.

    Raises:
        TrainError: the folder belongs to a training with other settings, or the loss is not finite.
    """
    with _process_group() as group:
        return _train(out, config, notify if group.rank == 0 else ignore, group)


def _train(out: Path, config: TrainConfig, notify: Listener, group: ProcessGroup) -> Path:
    network = build(config.network(), config.seed)
    if config.init is not None:
        begin_from(network, config.init)
    network = network.to(group.device)
    state = initial_state(network, config.optimiser.rate, config.optimiser.decay)
    if is_file(out / STATE):
        state = load_state(out / STATE, state, fingerprint(config))
    tracker = Tracker(out, notify) if group.rank == 0 else None
    validation = _validation_cases(config) if tracker else []
    stream = batches(recipe(config), state.step, config.loader.workers, group.rank, group.world)
    started, saved, before = time.monotonic(), time.monotonic(), state.seconds
    try:
        with stop_signals() as stopped:
            for batch in stream:
                seconds, stop = _agreed(before + time.monotonic() - started, stopped.is_set(), group)
                state.seconds = max(seconds, state.seconds)
                if spent(config, state) >= 1.0 or stop:
                    break
                figures = step(state, batch.to(group.device), config, group.world)
                if tracker is None:
                    continue
                _tell(tracker, state, figures, config, notify)
                if state.step % config.validate_every == 0:
                    validate(tracker, state, validation, config)
                if time.monotonic() - saved > config.save_every:
                    _save(out, state, config)
                    saved = time.monotonic()
    finally:
        if tracker:
            _save(out, state, config)
            tracker.close()
    if stopped.is_set():
        raise KeyboardInterrupt
    return out / WEIGHTS


def _save(out: Path, state: TrainState, config: TrainConfig) -> None:
    save_state(out / STATE, state, fingerprint(config))
    save_network(out / WEIGHTS, state.averaged(build(config.network())), _notes(config, state), half=True)


@contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """Make Ctrl-C and SIGTERM set an event, so that training stops after the current step and saves a whole state."""
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked  # only the main thread hears signals
        return
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(kind, lambda *_: asked.set()) for kind in kinds]
    try:
        yield asked
    finally:
        for kind, handler in zip(kinds, before, strict=True):
            signal.signal(kind, handler)


def fingerprint(config: TrainConfig) -> str:
    """Hash of the settings that a checkpoint depends on.

    Budget, learning rate, data folder, first weights, workers and reporting are left out: they may change between runs.
    """
    slower = replace(config.optimiser, rate=1.0)
    same = replace(config, minutes=1.0, steps=None, save_every=60.0, validate_every=1, optimiser=slower)
    same = replace(same, data=None, init=None, loader=replace(config.loader, workers=0))
    return hashlib.sha256(msgspec.json.encode(asdict(same), order="sorted")).hexdigest()


def recipe(config: TrainConfig) -> BatchRecipe:
    """The recipe of this training's batches: evidence and points as its network takes them."""
    network = config.network()
    if isinstance(network, LiteConfig):
        cells, points, hints = network.cells, 0, network.hints
    else:
        cells, points, hints = _CELLS_OF_POINTS, network.points, False
    masking = replace(config.masking, points=points)
    return BatchRecipe(
        loader=config.loader, masking=masking, cells=cells, hints=hints, data=config.data, seed=config.seed
    )


def spent(config: TrainConfig, state: TrainState) -> float:
    """Share of the budget that is used up."""
    return state.step / config.steps if config.steps else state.seconds / (60.0 * config.minutes)


def rate_factor(share: float, warmup: float) -> float:
    """Warm-up from 0, then linear to 0 at the end of the budget."""
    return min(share / warmup if warmup > 0 else 1.0, (1.0 - share) / (1.0 - warmup), 1.0)


def has_bf16(device: torch.device) -> bool:
    """Whether a device multiplies in bfloat16 itself: GPUs do, and CPUs with more than AVX2."""
    return device.type != "cpu" or torch.backends.cpu.get_cpu_capability() not in ("DEFAULT", "NO AVX", "AVX2")


def step(state: TrainState, batch: TrainingBatch, config: TrainConfig, world: int = 1) -> dict[str, float]:
    """One step of AdamW and of the running mean; gives the terms of the loss and the IoU at the queries.

    The gradient is the mean over the `world` processes, which all call this.

    Raises:
        TrainError: the loss is not finite.
    """
    share = max(spent(config, state), 0.5 * config.optimiser.warmup / 100)
    for group in state.optimiser.param_groups:
        group["lr"] = config.optimiser.rate * max(0.0, rate_factor(share, config.optimiser.warmup))
    torch.manual_seed(int(np.random.SeedSequence([config.seed, state.step]).generate_state(1)[0]))
    state.network.train()
    device = batch.queries.device
    with torch.autocast(device.type, torch.bfloat16, enabled=config.optimiser.bf16 and has_bf16(device)):
        logits, divergence = state.network(batch.seen, batch.queries)
    terms = completion_loss(logits.float(), divergence.float(), batch.distance, config.losses)
    if not math.isfinite(terms["loss"].item()):
        raise TrainError(
            f"The loss is not finite at step {state.step}. Lower --optimiser.rate; resume starts before it."
        )
    state.optimiser.zero_grad(set_to_none=True)
    terms["loss"].backward()
    if world > 1:
        _average_gradients(state.network, world)
    norm = nn.utils.clip_grad_norm_(state.network.parameters(), config.optimiser.clip)
    state.optimiser.step()
    state.step += 1
    state.update_average(config.optimiser.ema_decay)
    iou = hard_iou(logits.float(), batch.distance, config.losses.threshold).mean()
    rate = state.optimiser.param_groups[0]["lr"]
    return {name: _number(value) for name, value in {**terms, "norm": norm, "query_iou": iou, "rate": rate}.items()}


def _average_gradients(network: nn.Module, world: int) -> None:
    """Replace every gradient by its mean over the processes, in one exchange.

    DistributedDataParallel does this too, but leaves threads behind that abort now and then as the process ends.
    """
    gradients = [parameter.grad for parameter in network.parameters() if parameter.grad is not None]
    flat = torch.cat([gradient.reshape(-1) for gradient in gradients])
    distributed.all_reduce(flat)
    for gradient, mean in zip(gradients, (flat / world).split([g.numel() for g in gradients]), strict=True):
        gradient.copy_(mean.view_as(gradient))


def validate(tracker: Tracker, state: TrainState, cases: list[ValidationCase], config: TrainConfig) -> None:
    """Score the averaged weights on the validation cases, and preview some of these."""
    device = next(state.network.parameters()).device
    network = state.averaged(build(config.network()).to(device))
    fields = [case.composed(guess_network(case, network, config.losses.threshold)) for case in cases]
    scores = [score(case, field) for case, field in zip(cases, fields, strict=True)]
    tracker.scalars(
        state.step,
        {
            "validation/iou": float(np.mean([one.iou for one in scores])),
            "validation/unknown_accuracy": float(np.mean([one.unknown_accuracy for one in scores])),
        },
    )
    rows = [preview(case, [field]) for case, field in list(zip(cases, fields, strict=True))[:8]]
    tracker.picture(state.step, "completions", tiled([sum(rows[i : i + 2], []) for i in range(0, len(rows), 2)]))


def _validation_cases(config: TrainConfig) -> list[ValidationCase]:
    """Masked procedural shapes, drawn with a seed that training does not use."""
    made = recipe(config)

    def draw(random: np.random.Generator) -> WatertightShape:
        return random_shape(random, config.loader.resolution)

    cells = made.cells if config.size == "lite" else 32
    return list(validation_cases(draw, _VALIDATION_SHAPES, made.masking, cells, seed=(config.seed, 2**31)))


def _tell(
    tracker: Tracker, state: TrainState, figures: dict[str, float], config: TrainConfig, notify: Listener
) -> None:
    if state.step % 10 == 0 or state.step == 1:
        tracker.scalars(state.step, {f"train/{name}": value for name, value in figures.items()})
    done = round(1000 * min(spent(config, state), 1.0))
    total = config.steps or 1000
    shown = {"steps": float(state.step), "loss e-3": 1e3 * figures["loss"], "IoU %": 100 * figures["query_iou"]}
    notify(Progress(stage="train", done=state.step if config.steps else done, total=total, figures=shown))


def _notes(config: TrainConfig, state: TrainState) -> dict[str, str]:
    return {
        "training": msgspec.json.encode(asdict(replace(config, data=None, init=None))).decode(),
        "steps": str(state.step),
        "minutes": f"{state.seconds / 60:.1f}",
    }


def _number(value: Tensor | float) -> float:
    return float(value.detach()) if isinstance(value, Tensor) else float(value)


@contextmanager
def _process_group() -> Iterator[ProcessGroup]:
    """Among the processes of torchrun; alone without it."""
    world, rank = int(os.environ.get("WORLD_SIZE", "1")), int(os.environ.get("RANK", "0"))
    cuda = torch.cuda.is_available()
    device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0"))) if cuda else torch.device("cpu")
    if world == 1:
        yield ProcessGroup(rank=0, world=1, device=device)
        return
    distributed.init_process_group("nccl" if cuda else "gloo")
    try:
        yield ProcessGroup(rank=rank, world=world, device=device)
    finally:
        distributed.destroy_process_group()


def _agreed(seconds: float, stop: bool, group: ProcessGroup) -> tuple[float, bool]:
    """The first process's clock, and whether any was asked to stop: all go on, or stop, before the same step."""
    if group.world == 1:
        return seconds, stop
    told = torch.tensor([seconds if group.rank == 0 else 0.0, float(stop)], dtype=torch.float64, device=group.device)
    distributed.all_reduce(told)
    return float(told[0]), bool(told[1] > 0)
