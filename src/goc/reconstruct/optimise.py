"""The optimisation of paper §4.4: training steps and the MCMC moves between them."""

import math
from collections.abc import Callable
from pathlib import Path

from goc.events import Listener, Progress, Snapshot
from goc.reconstruct.mcmc import move
from goc.reconstruct.state import State, load_checkpoint, save_checkpoint
from goc.reconstruct.step import training_steps
from goc.reconstruct.task import Task

_STEPS_A_SNAPSHOT = 50
"""A snapshot copies nothing, so listeners may have many; this is often enough for an eye."""


def optimise(task: Task, begin: Callable[[], State], notify: Listener, checkpoint: Path | None, resume: bool) -> State:
    """Run all steps, or those after the checkpoint; the result does not depend on where it was interrupted.

    Raises:
        ReconstructError: the loss of a view is not finite, or the checkpoint belongs to something else.
    """
    config = task.config
    state = load_checkpoint(checkpoint, task.fingerprint()) if checkpoint and resume else begin()
    state = state.to(task.engine.device)
    shown_psnr = math.nan
    with training_steps(task) as descend:
        while state.step < config.iterations:
            psnr = descend(state)
            move(task, state)
            state.step += 1
            if psnr is not None:
                shown_psnr = psnr if math.isnan(shown_psnr) else 0.95 * shown_psnr + 0.05 * psnr
            figures = {"PSNR dB": shown_psnr, "splats": float(state.splats)}
            notify(Progress(stage="reconstruct", done=state.step, total=config.iterations, figures=figures))
            if state.step % _STEPS_A_SNAPSHOT == 0 or state.step == config.iterations:
                notify(Snapshot(stage="reconstruct", step=state.step, splats=state.gaussians().detached()))
            due = config.checkpoint_every and state.step % config.checkpoint_every == 0
            if checkpoint and (due or state.step == config.iterations):
                save_checkpoint(checkpoint, state, task.fingerprint())
    return state
