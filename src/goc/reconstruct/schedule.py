"""What happens when: the views of a step, epochs, and learning rates."""

import torch

from goc.reconstruct.adam import Rates
from goc.reconstruct.state import State
from goc.reconstruct.task import Task, generator_of


def views_of_step(task: Task, step: int) -> list[int]:
    """Every view once an epoch, in a new order each time."""
    found = []
    for drawn in range(step * task.config.views_a_step, (step + 1) * task.config.views_a_step):
        epoch, place = divmod(drawn, len(task.views))
        order = torch.randperm(len(task.views), generator=generator_of(task.config, 0, epoch))
        found.append(task.views[int(order[place])])
    return found


def epoch_of_step(task: Task, step: int) -> int:
    """How often all training views were drawn before a step: views drawn so far over training views, rounded down."""
    return step * task.config.views_a_step // len(task.views)


def steps_of_epoch(task: Task) -> int:
    """Steps in which every training view is drawn once, rounded up."""
    return -(-len(task.views) // task.config.views_a_step)


def rates_of_step(task: Task, state: State) -> Rates:
    """Step sizes of each parameter, by column where they differ."""
    rates = task.config.rates
    found: Rates = {
        "means": (means_rate(task, state.step),),
        "quats": (rates.quats,),
        "log_scales": (rates.log_scales,),
        "opacity_logits": (rates.opacity_logits,),
        "sh": (*[rates.sh_constant] * 3, rates.sh_rest),
        "identity": (rates.identity,),
    }
    return found | {f"classifier.{name}": (rates.identity,) for name in state.shared}


def means_rate(task: Task, step: int) -> float:
    """Step size of the means, scene units: it falls exponentially."""
    rates, share = task.config.rates, step / max(1, task.config.iterations)
    return rates.means * task.extent * rates.means_final**share
