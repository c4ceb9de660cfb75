"""A view against one of its neighbours, and what is remembered of views between steps."""

import torch
from jaxtyping import Float
from torch import Tensor

from goc.reconstruct.depth import draw_depth
from goc.reconstruct.losses import Neighbour, PairWeights, RenderedDepth, inverse_depth, multiview_loss
from goc.reconstruct.pairs import Pairs
from goc.reconstruct.schedule import steps_of_epoch
from goc.reconstruct.state import State
from goc.reconstruct.task import Task, generator_of
from goc.reconstruct.training_views import TrainingView, TrainingViews


def pair_loss(
    task: Task, provider: TrainingViews, state: State, item: TrainingView, depth: RenderedDepth
) -> Float[Tensor, ""] | None:
    """λ_pho·L_pho + λ_geo·L_geo of a view against the neighbour that the step decides; None without one.

    Args:
        task: what is optimised.
        provider: gives the neighbour.
        state: the splats, and what is remembered of views.
        item: the view.
        depth: what it shows, alone.
    """
    if task.pairs is None:
        return None
    other = neighbour_of_step(task, task.pairs, state, item.index, depth)
    if other is None:
        return None
    neighbour = _neighbour(task, task.pairs, state, provider.get(other, state.views))
    losses, tolerance = task.config.losses, task.config.losses.multiview.tolerance
    weights = PairWeights(photometric=losses.photometric, geometric=losses.geometric, tolerance=tolerance)
    return multiview_loss(depth, item.views, item.image, neighbour, weights)


def neighbour_of_step(task: Task, pairs: Pairs, state: State, view: int, depth: RenderedDepth) -> int | None:
    """The neighbour that a view is compared with at this step; None before the start, or where none can be.

    With `cached` depths the view's own is remembered in `state.views` for those it is a neighbour of. They start an
    epoch early, so that every neighbour has one when the comparison does; a view without one is left out.
    """
    config = task.config.losses.multiview
    cached = config.neighbour_depth == "cached"
    start = round(config.start * task.config.iterations)
    others = pairs.neighbours[view]
    if cached:
        others = tuple(other for other in others if _memory_key(other) in state.views)
        if state.step >= start - steps_of_epoch(task):
            _remember(task, pairs, state, view, depth)
    if state.step < start or not others:
        return None
    return others[int(torch.randint(0, len(others), (), generator=generator_of(task.config, 3, state.step)))]


def _neighbour(task: Task, pairs: Pairs, state: State, item: TrainingView) -> Neighbour:
    if task.config.losses.multiview.neighbour_depth == "rendered":
        inverse, stride = inverse_depth(draw_depth(state.gaussians(), item.views, task.config.depth, task.engine)), 1
        inverse = inverse.squeeze(0)
    else:
        remembered = state.views[_memory_key(item.index)].to(task.engine.device)
        inverse, stride = remembered.float() / task.capture.units_per_metre, pairs.stride
    return Neighbour(views=item.views, image=item.image, inverse_depth=inverse, stride=stride)


@torch.no_grad()
def _remember(task: Task, pairs: Pairs, state: State, view: int, depth: RenderedDepth) -> None:
    """Keep 1/z per metre in half precision: 0.05 % of the depth, and linear between pixels on planes."""
    kept = (slice(None), *(slice(pairs.stride // 2, None, pairs.stride),) * 2)
    few = RenderedDepth(numerator=depth.numerator[kept], denominator=depth.denominator[kept], alpha=depth.alpha[kept])
    state.views[_memory_key(view)] = (inverse_depth(few)[0] * task.capture.units_per_metre).half()


def _memory_key(view: int) -> str:
    """Under which a view's inverse depth per metre is remembered."""
    return f"inverse_depth/{view}"
