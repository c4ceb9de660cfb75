"""The optimisation of paper §4.4: a view or a few a step, Eq. (6), Adam, MCMC moves."""

import math
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from goc import _native
from goc.errors import ReconstructError
from goc.events import Listener, Progress
from goc.reconstruct.config import ReconstructConfig
from goc.reconstruct.device_step import device_steps
from goc.reconstruct.mcmc import draw, exploration, relocated
from goc.reconstruct.state import State, load_checkpoint, save_checkpoint
from goc.reconstruct.task import Task, generator_of, not_finite
from goc.reconstruct.view_loss import view_loss

_EXPLORING = math.log(0.1 / 0.9)
"""Logit of 0.1: splats more opaque than that would move by less than 1e-4 of what a transparent one does. They are left
alone."""


def optimise(task: Task, begin: Callable[[], State], notify: Listener, checkpoint: Path | None, resume: bool) -> State:
    """Run all steps, or those after the checkpoint; the result does not depend on where it was interrupted.

    Raises:
        ReconstructError: the loss of a view is not finite, or the checkpoint belongs to something else.
    """
    config = task.config
    state = load_checkpoint(checkpoint, task.fingerprint()) if checkpoint and resume else begin()
    state = state.to(task.engine.device)
    shown_psnr = math.nan
    fused = task.engine.fused
    with nullcontext(partial(_native_step, task)) if fused else device_steps(task, views_of_step) as descend:
        while state.step < config.iterations:
            psnr = descend(state, _rates(task, state))
            _move(task, state)
            state.step += 1
            if psnr is not None:
                shown_psnr = psnr if math.isnan(shown_psnr) else 0.95 * shown_psnr + 0.05 * psnr
            figures = {"PSNR dB": shown_psnr, "splats": float(state.splats)}
            notify(Progress(stage="reconstruct", done=state.step, total=config.iterations, figures=figures))
            due = config.checkpoint_every and state.step % config.checkpoint_every == 0
            if checkpoint and (due or state.step == config.iterations):
                save_checkpoint(checkpoint, state, task.fingerprint())
    return state


def _native_step(task: Task, state: State, rates: dict[str, tuple[float, ...]]) -> float:
    """Gradients of the step's views, one after the other, and Adam; the PSNR of the last view, dB."""
    views = views_of_step(task, state.step)
    for view in views:
        loss, psnr = view_loss(task, state, view)
        if not math.isfinite(loss.item()):
            raise ReconstructError(not_finite(task, view, state.step))
        (loss if len(views) == 1 else loss / len(views)).backward()
    _add_penalties(state, task.config)
    state.adam(rates)
    return psnr


def views_of_step(task: Task, step: int) -> list[int]:
    """Every view once an epoch, in a new order each time."""
    found = []
    for drawn in range(step * task.config.views_a_step, (step + 1) * task.config.views_a_step):
        epoch, place = divmod(drawn, len(task.views))
        order = torch.randperm(len(task.views), generator=generator_of(task.config, 0, epoch))
        found.append(task.views[int(order[place])])
    return found


def _rates(task: Task, state: State) -> dict[str, tuple[float, ...]]:
    """Of each parameter, by column where they differ."""
    rates = task.config.rates
    found = {
        "means": (_means_rate(task, state),),
        "quats": (rates.quats,),
        "log_scales": (rates.log_scales,),
        "opacity_logits": (rates.opacity_logits,),
        "sh": (*[rates.sh_constant] * 3, rates.sh_rest),
        "identity": (rates.identity,),
    }
    return found | {f"classifier.{name}": (rates.identity,) for name in state.shared}


def _means_rate(task: Task, state: State) -> float:
    rates, share = task.config.rates, state.step / max(1, task.config.iterations)
    return rates.means * task.extent * rates.means_final**share


@torch.no_grad()
def _add_penalties(state: State, config: ReconstructConfig) -> None:
    """Pull the opacity and size of the splats in view down; unseen splats would melt away (measured: gsplat #778)."""
    logits, log_scales = state.parameters["opacity_logits"], state.parameters["log_scales"]
    if logits.grad is not None and log_scales.grad is not None:
        weights = config.mcmc.opacity_penalty, config.mcmc.scale_penalty
        _native.add_penalties(logits.detach(), log_scales.detach(), *weights, logits.grad, log_scales.grad)


@torch.no_grad()
def _move(task: Task, state: State) -> None:
    """Exploration noise after every step; relocation and growth now and then."""
    config, step = task.config, state.step
    mcmc, share = config.mcmc, (step + 1) / config.iterations
    if not mcmc.start <= share <= mcmc.stop:
        return
    generator = generator_of(config, 2, step, device=task.engine.device)
    if (step + 1) % mcmc.every == 0:
        _relocate(state, mcmc.min_opacity, generator)
        _grow(state, min(task.budget, math.ceil(state.splats * (1 + mcmc.growth))), mcmc.min_opacity, generator)
    p = state.parameters
    strength = mcmc.noise * _means_rate(task, state)
    logits = p["opacity_logits"]
    # To find these rows is to wait for a device; there it is cheaper to move all of them.
    rows = torch.nonzero(logits < _EXPLORING)[:, 0] if task.engine.fused else slice(None)
    opacities = logits[rows].sigmoid()
    p["means"][rows] += exploration(p["log_scales"][rows], p["quats"][rows], opacities, strength, generator)


def _relocate(state: State, min_opacity: float, generator: torch.Generator) -> None:
    """Move dead splats to live ones drawn by opacity; all copies together look like the one they replace."""
    opacities = state.parameters["opacity_logits"].sigmoid()
    dead = torch.nonzero(opacities <= min_opacity)[:, 0]
    alive = torch.nonzero(opacities > min_opacity)[:, 0]
    if len(dead) == 0 or len(alive) == 0:
        return
    targets = alive[draw(opacities[alive], len(dead), generator)]
    _share(state, targets, min_opacity)
    for name in state.per_splat:
        state.parameters[name][dead] = state.parameters[name][targets]
    state.forget(dead)


def _grow(state: State, wanted: int, min_opacity: float, generator: torch.Generator) -> None:
    """Add splats as copies of live ones drawn by opacity."""
    count = wanted - state.splats
    if count <= 0:
        return
    targets = draw(state.parameters["opacity_logits"].sigmoid(), count, generator)
    _share(state, targets, min_opacity)
    state.resize(torch.cat([torch.arange(state.splats, device=targets.device), targets]))


def _share(state: State, targets: Tensor, min_opacity: float) -> None:
    """Give each target the opacity and size of one of its copies, itself included."""
    rows, counts = torch.unique(targets, return_counts=True)
    logits, log_scales = state.parameters["opacity_logits"], state.parameters["log_scales"]
    opacities, scales = relocated(logits[rows].sigmoid(), log_scales[rows].exp(), counts + 1)
    logits[rows] = torch.logit(opacities.clamp(min_opacity, 1 - 1e-6))
    log_scales[rows] = scales.log()
    state.forget(rows)
