"""One training step: Eq. (6) over a batch of views, its gradients, and Adam; the same for every engine."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from goc.errors import ReconstructError
from goc.raster import BlendedViews, blend_views, joined_views, stacked
from goc.reconstruct.adam import adam
from goc.reconstruct.labels import classify
from goc.reconstruct.losses import (
    GeometryPrior,
    RenderedDepth,
    geometry_loss,
    identity_loss,
    photometric_loss,
    rendered_depth,
    stacked_priors,
)
from goc.reconstruct.losses.identity import classes_of
from goc.reconstruct.losses.penalties import add_penalties
from goc.reconstruct.pair_loss import pair_loss
from goc.reconstruct.schedule import epoch_of_step, rates_of_step, views_of_step
from goc.reconstruct.state import State
from goc.reconstruct.task import Task, generator_of
from goc.reconstruct.training_views import TrainingView, TrainingViews, training_views
from goc.scene.capture import UNLABELLED

_LOOK_EVERY = 50
"""Steps between looks at what steps on a device found out; a loss that is not finite is noticed that much later."""
_IDENTITY_PIXELS = 16_384
"""Pixels a step whose features are classified, at most: all of them would make the MLP dearer than the view."""


@contextmanager
def training_steps(task: Task) -> Iterator["TrainingStep"]:
    """Steps of a task on its engine; the upload of views ends with them."""
    with training_views(task, task.engine) as provider:
        yield TrainingStep(task, provider)


class TrainingStep:
    """Called once a step.

    A fused engine takes the views one after the other and adds their gradients up; another one blends all views of one
    size in one call. What a step finds out (loss, error) stays where it was computed and is looked at when it is time:
    at once on the processor, every 50 steps on a device, which nothing waits for in between.
    """

    def __init__(self, task: Task, provider: TrainingViews) -> None:
        """Steps of a task on the views that a provider gives."""
        self._task, self._provider = task, provider
        self._known = torch.tensor(task.names, dtype=torch.int16, device=task.engine.device)
        self._found: list[tuple[int, TrainingView, Tensor]] = []

    def __call__(self, state: State) -> float | None:
        """Gradients of the step's views, and Adam.

        Returns:
            The mean PSNR since the last look, dB, where it is time for one.

        Raises:
            ReconstructError: at a look, a loss since the last one was not finite.
        """
        task, remembered = self._task, state.views
        batch = [self._provider.get(view, remembered) for view in views_of_step(task, state.step)]
        for part in _drawn_together(batch, task.engine.fused):
            loss, error = self._loss(state, part)
            (loss * (len(part) / len(batch))).backward()
            self._found.append((state.step, part[0], torch.stack([loss.detach(), error])))
        self._provider.prefetch(views_of_step(task, state.step + 1), remembered)
        add_penalties(state.parameters["opacity_logits"], state.parameters["log_scales"], task.config.mcmc)
        adam(state, rates_of_step(task, state))
        return self._look() if self._is_due(state.step + 1) else None

    def _is_due(self, done: int) -> bool:
        config = self._task.config
        saved = config.checkpoint_every and done % config.checkpoint_every == 0
        return bool(self._task.engine.fused or done % _LOOK_EVERY == 0 or saved or done == config.iterations)

    def _look(self) -> float:
        figures = torch.stack([figure for _, _, figure in self._found]).tolist()
        for (step, item, _), (loss, _) in zip(self._found, figures, strict=True):
            if not math.isfinite(loss):
                raise ReconstructError(
                    f"{self._task.capture.view_names[item.index]}: the loss is not finite at step {step}. "
                    "Check this view's depth and pose, or lower --reconstruct.rates."
                )
        self._found = []
        return sum(-10.0 * math.log10(max(error, 1e-10)) for _, error in figures) / len(figures)

    def _loss(self, state: State, batch: list[TrainingView]) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
        """Mean of Eq. (6) over views of one size, and their mean squared error."""
        task, weights = self._task, self._task.config.losses
        views, gaussians = joined_views([item.views for item in batch]), state.gaussians()
        if state.step % weights.identity_every:  # a step without L_o needs no features
            gaussians = replace(gaussians, identity=None)
        shown = blend_views(gaussians, views, task.config.depth == "plane", task.engine)
        colour = _where_valid(shown.colour, batch)
        loss, error = photometric_loss(colour, stacked([item.image for item in batch]), weights.ssim)
        depth = rendered_depth(shown.geometry, shown.alpha, views)
        apart = depth.apart()
        if weights.depth or weights.depth_normal:
            prior = self._prior(state, batch, apart)
            if prior is not None:
                depth_weight = weights.depth / task.capture.units_per_metre
                loss = loss + geometry_loss(depth, prior, views, depth_weight, weights.depth_normal)
        pairs = (pair_loss(task, self._provider, state, *one) for one in zip(batch, apart, strict=True))
        compared = [pair for pair in pairs if pair is not None]
        if compared:
            loss = loss + torch.stack(compared).sum() / len(batch)
        if weights.identity and shown.features is not None and any(item.ids is not None for item in batch):
            loss = loss + weights.identity * weights.identity_every * self._identity_loss(state, shown, batch)
        return loss, error

    def _prior(self, state: State, batch: list[TrainingView], apart: list[RenderedDepth]) -> GeometryPrior | None:
        """What the geometry of the batch is compared with."""
        epoch, remembered = epoch_of_step(self._task, state.step), state.views
        pairs = zip(batch, apart, strict=True)
        return stacked_priors([self._provider.prior(item, remembered, depth, epoch) for item, depth in pairs])

    def _identity_loss(self, state: State, shown: BlendedViews, batch: list[TrainingView]) -> Float[Tensor, ""]:
        """L_o on a grid of pixels that the step shifts: rows of images are read in order, scattered pixels singly."""
        features, size = shown.features, shown.alpha.shape[1:]
        assert features is not None
        grid = identity_grid(self._task, state.step, size.numel())
        blank = self._known.new_full((), UNLABELLED).expand(size)
        ids = stacked([(blank if item.ids is None else item.ids)[grid] for item in batch]).flatten(1)
        picked = features[:, :, *grid].flatten(2).transpose(1, 2)
        logits = classify(picked.flatten(0, 1), state.shared)
        return identity_loss(logits.view(*ids.shape, -1), classes_of(ids, self._known))


def _where_valid(colour: Float[Tensor, "v 3 h w"], batch: list[TrainingView]) -> Float[Tensor, "v 3 h w"]:
    """Blended colours; where a photograph shows nothing, its own, so that they differ in nothing."""
    if all(item.valid is None for item in batch):
        return colour
    parts = []
    for one, item in zip(colour, batch, strict=True):
        photo = item.image.permute(2, 0, 1).to(one.dtype) / 255.0
        parts.append(one if item.valid is None else torch.where(item.valid, one, photo))
    return torch.stack(parts)


def _drawn_together(batch: list[TrainingView], one_by_one: bool) -> list[list[TrainingView]]:
    """Views that are blended in one call: of one size."""
    if one_by_one:
        return [[item] for item in batch]
    groups: dict[tuple[int, int], list[TrainingView]] = {}
    for item in batch:
        groups.setdefault((item.views.height, item.views.width), []).append(item)
    return list(groups.values())


def identity_grid(task: Task, step: int, pixels: int) -> tuple[slice, slice]:
    """Rows and columns that L_o looks at in a step: every so many, from a place that the step draws."""
    stride = identity_stride(pixels)
    x, y = torch.randint(0, stride, (2,), generator=generator_of(task.config, 1, step)).tolist()
    return slice(y, None, stride), slice(x, None, stride)


def identity_stride(pixels: int) -> int:
    """Every how many pixels, across and down, L_o looks at one: the fewest that keep to the budget."""
    return math.ceil(math.sqrt(pixels / _IDENTITY_PIXELS))
