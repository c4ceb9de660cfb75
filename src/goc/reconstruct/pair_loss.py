"""A view against one of its neighbours, and what is remembered of views between steps."""

import torch
from jaxtyping import Float
from torch import Tensor

from goc.reconstruct.depth import draw_depth
from goc.reconstruct.losses import RenderedDepth
from goc.reconstruct.multiview import Neighbour, PairWeights, inverse_depth, multiview_loss
from goc.reconstruct.pairs import Pairs
from goc.reconstruct.state import State
from goc.reconstruct.task import Task, generator_of


def pair_loss(task: Task, pairs: Pairs, state: State, view: int, depth: RenderedDepth) -> Float[Tensor, ""]:
    """λ_pho·L_pho + λ_geo·L_geo of a view against the neighbour that the step decides; 0 without one."""
    other = neighbour_of_step(task, pairs, state, view, depth)
    if other is None:
        return torch.zeros(())
    return multiview_loss(depth, task.capture[view], _neighbour(task, pairs, state, other), pair_weights(task))


def pair_weights(task: Task) -> PairWeights:
    """What the losses of a pair are worth."""
    losses, tolerance = task.config.losses, task.config.multiview.tolerance
    return PairWeights(photometric=losses.photometric, geometric=losses.geometric, tolerance=tolerance)


def neighbour_of_step(task: Task, pairs: Pairs, state: State, view: int, depth: RenderedDepth) -> int | None:
    """The neighbour that a view is compared with at this step; None before the start, or where none can be.

    With `cached` depths the view's own is remembered in `state.views` for those it is a neighbour of. They start an
    epoch early, so that every neighbour has one when the comparison does; a view without one is left out.
    """
    config = task.config.multiview
    cached = config.neighbour_depth == "cached"
    start = round(config.start * task.config.iterations)
    others = pairs.neighbours[view]
    if cached:
        others = tuple(other for other in others if memory_key(other) in state.views)
        if state.step >= start - len(task.views):
            _remember(task, pairs, state, view, depth)
    if state.step < start or not others:
        return None
    return others[int(torch.randint(0, len(others), (), generator=generator_of(task.config, 3, state.step)))]


def _neighbour(task: Task, pairs: Pairs, state: State, view: int) -> Neighbour:
    frame = task.capture[view]
    if task.config.multiview.neighbour_depth == "rendered":
        inverse, stride = inverse_depth(draw_depth(state.gaussians(), frame.camera, task.config.depth)), 1
    else:
        inverse, stride = state.views[memory_key(view)].float() / task.capture.units_per_metre, pairs.stride
    return Neighbour(camera=frame.camera, image=frame.image, inverse_depth=inverse, stride=stride)


@torch.no_grad()
def _remember(task: Task, pairs: Pairs, state: State, view: int, depth: RenderedDepth) -> None:
    """Keep 1/z per metre in half precision: 0.05 % of the depth, and linear between pixels on planes."""
    kept = (slice(pairs.stride // 2, None, pairs.stride),) * 2
    few = RenderedDepth(numerator=depth.numerator[kept], denominator=depth.denominator[kept], alpha=depth.alpha[kept])
    state.views[memory_key(view)] = (inverse_depth(few) * task.capture.units_per_metre).half()


def memory_key(view: int) -> str:
    """Under which a view's inverse depth per metre is remembered."""
    return f"inverse_depth/{view}"
