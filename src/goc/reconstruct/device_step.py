"""Optimisation steps in plain PyTorch, where the splats are: several views a call, and nothing that waits for a device.

The same maths as the native steps, which are their twin in the tests. What a step finds out (loss, error) stays on the
device and is looked at now and then.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from goc.errors import ReconstructError
from goc.raster import joined_views, view_channels
from goc.reconstruct.config import Mcmc
from goc.reconstruct.device_losses import Depths, Priors, blended_depths, geometry, identity, photometric
from goc.reconstruct.device_pairs import Beside, Drawn, pair_losses
from goc.reconstruct.device_views import DeviceView, DeviceViews
from goc.reconstruct.labels import classify
from goc.reconstruct.losses import RenderedDepth
from goc.reconstruct.multiview import inverse_depth
from goc.reconstruct.pair_loss import memory_key, neighbour_of_step, pair_weights
from goc.reconstruct.state import BETA1, BETA2, EPSILON, State
from goc.reconstruct.task import Task, not_finite
from goc.reconstruct.view_loss import identity_grid, with_identity

Order = Callable[[Task, int], list[int]]
"""The views of a step."""
_LOOK_EVERY = 50
"""Steps between looks at what steps found out; a loss that is not finite is noticed that much later."""


@contextmanager
def device_steps(task: Task, order: Order) -> Iterator["DeviceSteps"]:
    """Steps of a task on its engine's device; the upload of views ends with them."""
    with DeviceViews(task, task.engine.device) as views:
        yield DeviceSteps(task, order, views)


class DeviceSteps:
    """Called once a step."""

    def __init__(self, task: Task, order: Order, views: DeviceViews) -> None:
        """Steps on views that are or will be on the device."""
        self._task, self._order, self._views = task, order, views
        self._found: list[tuple[int, list[int], Tensor]] = []

    def __call__(self, state: State, rates: dict[str, tuple[float, ...]]) -> float | None:
        """Gradients of the step's views, Adam; the mean PSNR since the last look, dB, where it is time for one.

        Raises:
            ReconstructError: at a look, a loss since the last one was not finite.
        """
        chosen = self._order(self._task, state.step)
        batch = [self._views.get(view, state.views) for view in chosen]
        losses, errors = [], []
        for places in _of_one_size(batch):
            loss, error = self._loss(state, [chosen[place] for place in places], [batch[place] for place in places])
            losses.append(loss * (len(places) / len(batch)))
            errors.append(error * (len(places) / len(batch)))
        total = torch.stack(losses).sum()
        total.backward()
        self._views.prefetch(self._order(self._task, state.step + 1), state.views)
        add_penalties(state, self._task.config.mcmc)
        adam(state, rates)
        self._found.append((state.step, chosen, torch.stack([total.detach(), torch.stack(errors).sum()])))
        return self._look() if self._is_due(state.step + 1) else None

    def _is_due(self, done: int) -> bool:
        config = self._task.config
        saved = config.checkpoint_every and done % config.checkpoint_every == 0
        return bool(done % _LOOK_EVERY == 0 or saved or done == config.iterations)

    def _look(self) -> float:
        figures = torch.stack([figure for _, _, figure in self._found]).tolist()
        for (step, views, _), (loss, _) in zip(self._found, figures, strict=True):
            if not math.isfinite(loss):
                raise ReconstructError(not_finite(self._task, views[0], step))
        self._found = []
        return sum(-10.0 * math.log10(max(error, 1e-10)) for _, error in figures) / len(figures)

    def _loss(self, state: State, chosen: list[int], batch: list[DeviceView]) -> tuple[Tensor, Tensor]:
        """Mean of Eq. (6) over views of one size, and their mean squared error."""
        task, weights = self._task, self._task.config.losses
        views, gaussians = joined_views([view.views for view in batch]), with_identity(state, weights)
        planes = task.config.depth == "plane"
        blended, alpha = task.engine.blend(gaussians, views, view_channels(gaussians, views, planes))
        image, first = blended.permute(0, 3, 1, 2), 7 if planes else 4
        loss, error = photometric(image[:, :3], _photographs(batch), weights.ssim)
        depths = blended_depths(image[:, 3:first], alpha, views.rays)
        priors = self._priors(state, chosen, batch, depths) if weights.depth or weights.depth_normal else None
        if priors is not None:
            depth_weight = weights.depth / task.capture.units_per_metre
            loss = loss + geometry(depths, priors, views.rays, depth_weight, weights.depth_normal)
        if task.pairs is not None:
            pairs = zip(chosen, batch, strict=True)
            compared = [self._pair_loss(state, *pair, _one(depths, k)) for k, pair in enumerate(pairs)]
            loss = loss + torch.stack(compared).mean()
        if gaussians.identity is not None and weights.identity:
            features = image[:, first : first + gaussians.identity.shape[1]]
            loss = loss + weights.identity * weights.identity_every * self._identity_loss(state, features, batch)
        return loss, error

    def _priors(self, state: State, chosen: list[int], batch: list[DeviceView], depths: Depths) -> Priors | None:
        """What the views are compared with; NaN where one of them has nothing."""
        task, found = self._task, []
        epoch = state.step * task.config.views_a_step // len(task.views)
        for k, (view, item) in enumerate(zip(chosen, batch, strict=True)):
            prior = None if item.depth is None else (item.depth, item.normals)
            if self._views.waits(view, state.views):
                prior = self._views.fitted_prior(view, state.views, _one(depths, k), epoch)
            found.append(prior)
        if all(prior is None for prior in found):
            return None
        size = depths.alpha.shape[1:]
        nothing = depths.alpha.new_full(size, torch.nan)
        depth = torch.stack([nothing if prior is None else prior[0] for prior in found])
        if all(prior is None or prior[1] is None for prior in found):
            return Priors(depth=depth, normals=None)
        blank = nothing[..., None].expand(*size, 3)
        normals = [blank if prior is None or prior[1] is None else prior[1].to(blank.dtype) for prior in found]
        return Priors(depth=depth, normals=torch.stack(normals))

    def _pair_loss(self, state: State, view: int, item: DeviceView, depth: RenderedDepth) -> Float[Tensor, ""]:
        task, pairs = self._task, self._task.pairs
        assert pairs is not None
        other = neighbour_of_step(task, pairs, state, view, depth)
        if other is None:
            return depth.alpha.new_zeros(())
        beside = self._views.get(other, state.views)
        if task.config.multiview.neighbour_depth == "rendered":
            inverse, stride = self._drawn_inverse(state, beside), 1
        else:
            inverse = state.views[memory_key(other)].to(depth.alpha.device).float() / task.capture.units_per_metre
            stride = pairs.stride
        drawn = Drawn(
            views=item.views,
            numerator=depth.numerator,
            denominator=depth.denominator,
            alpha=depth.alpha,
            image=_photographs([item])[0],
        )
        there = Beside(views=beside.views, image=_photographs([beside])[0], inverse_depth=inverse, stride=stride)
        return pair_losses(drawn, there, pair_weights(task))

    def _drawn_inverse(self, state: State, item: DeviceView) -> Float[Tensor, "h w"]:
        """1/z of a view as the splats are now; differentiable."""
        planes = self._task.config.depth == "plane"
        gaussians = replace(state.gaussians(), identity=None)
        channels = view_channels(gaussians, item.views, planes)[..., 3 : 7 if planes else 4]
        blended, alpha = self._task.engine.blend(gaussians, item.views, channels)
        depths = blended_depths(blended.permute(0, 3, 1, 2), alpha, item.views.rays)
        return inverse_depth(_one(depths, 0))

    def _identity_loss(
        self, state: State, features: Float[Tensor, "v f h w"], batch: list[DeviceView]
    ) -> Float[Tensor, ""]:
        losses = []
        for item, feature in zip(batch, features, strict=True):
            if item.classes is not None:
                grid = identity_grid(self._task, state.step, item.classes.numel())
                logits = classify(feature[:, *grid].flatten(1).T, state.shared)
                losses.append(identity(logits, item.classes[grid].reshape(-1)))
        return torch.stack(losses).sum() / len(batch) if losses else features.new_zeros(())


@torch.no_grad()
def adam(state: State, rates: dict[str, tuple[float, ...]]) -> None:
    """One step of Adam on every parameter that has a gradient, as `State.adam`; clears the gradients."""
    step = state.step + 1
    unbias = math.sqrt(1.0 - BETA2**step)
    scale = unbias / (1.0 - BETA1**step)
    for name, parameter in state.parameters.items():
        gradient = parameter.grad
        if gradient is None or parameter.numel() == 0:
            continue
        first, second = state.first[name], state.second[name]
        first.lerp_(gradient, 1.0 - BETA1)
        second.mul_(BETA2).addcmul_(gradient, gradient, value=1.0 - BETA2)
        move = first / (second.sqrt() + EPSILON * unbias)
        rows, moves = parameter.detach().view(len(parameter), -1), move.view(len(parameter), -1)
        for columns, rate in _runs(rates[name], rows.shape[1]):
            rows[:, columns].add_(moves[:, columns], alpha=-rate * scale)
        parameter.grad = None


def _runs(rates: tuple[float, ...], width: int) -> list[tuple[slice, float]]:
    """Neighbouring columns of one rate; the last rate stands for all further columns."""
    every = (list(rates) + [rates[-1]] * width)[:width]
    starts = [k for k in range(width) if k == 0 or every[k] != every[k - 1]]
    return [(slice(a, b), every[a]) for a, b in zip(starts, [*starts[1:], width], strict=True)]


@torch.no_grad()
def add_penalties(state: State, config: Mcmc) -> None:
    """Pull the opacity and size of the splats in view down: of those with a gradient, which the others lack."""
    logits, log_scales = state.parameters["opacity_logits"], state.parameters["log_scales"]
    if logits.grad is None or log_scales.grad is None:
        return
    seen = (logits.grad != 0).to(logits.dtype)
    each = seen / seen.sum().clamp_min(1.0)
    opacities = logits.sigmoid()
    logits.grad.add_(each * opacities * (1.0 - opacities), alpha=config.opacity_penalty)
    log_scales.grad.add_(each[:, None] * log_scales.exp(), alpha=config.scale_penalty / 3.0)


def _of_one_size(batch: list[DeviceView]) -> list[list[int]]:
    groups: dict[tuple[int, int], list[int]] = {}
    for place, item in enumerate(batch):
        groups.setdefault((item.views.height, item.views.width), []).append(place)
    return list(groups.values())


def _photographs(batch: list[DeviceView]) -> Float[Tensor, "v 3 h w"]:
    return torch.stack([item.image for item in batch]).permute(0, 3, 1, 2).float() / 255.0


def _one(depths: Depths, place: int) -> RenderedDepth:
    return RenderedDepth(
        numerator=depths.numerator[place], denominator=depths.denominator[place], alpha=depths.alpha[place]
    )
