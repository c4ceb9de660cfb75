"""Eq. (6) of one view."""

import math
from dataclasses import replace

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc.raster import blend_view
from goc.reconstruct.config import LossWeights
from goc.reconstruct.depth import rendered_depth
from goc.reconstruct.labels import classify
from goc.reconstruct.losses import geometry_loss, identity_loss, photometric_loss
from goc.reconstruct.pair_loss import pair_loss
from goc.reconstruct.state import State
from goc.reconstruct.task import Task, generator_of
from goc.scene import Gaussians
from goc.scene.capture import UNLABELLED, Frame

_IDENTITY_PIXELS = 16_384
"""Pixels a step whose features are classified, at most: all of them would make the MLP dearer than the view."""


def view_loss(task: Task, state: State, view: int) -> tuple[Float[Tensor, ""], float]:
    """Eq. (6) of one view, and its PSNR in dB."""
    frame = task.capture[view]
    weights, camera = task.config.losses, frame.camera
    shown = blend_view(with_identity(state, weights), camera, planes=task.config.depth == "plane")
    loss, error = photometric_loss(shown.colour, frame.image, weights.ssim)
    depth = rendered_depth(shown.geometry, shown.alpha, camera)
    if weights.depth or weights.depth_normal:
        prior = task.prior(view, state.views, depth, state.step // len(task.views))
        if prior is not None:
            loss = loss + geometry_loss(
                depth, prior, camera, weights.depth / task.capture.units_per_metre, weights.depth_normal
            )
    if task.pairs is not None:
        loss = loss + pair_loss(task, task.pairs, state, view, depth)
    if shown.features is not None and frame.ids is not None and weights.identity:
        loss = loss + weights.identity * weights.identity_every * _identity_loss(task, state, shown.features, frame)
    return loss, -10.0 * math.log10(max(error, 1e-10))


def _identity_loss(task: Task, state: State, features: Float[Tensor, "f h w"], frame: Frame) -> Float[Tensor, ""]:
    """L_o on a grid of pixels that the step shifts: rows of images are read in order, scattered pixels one by one."""
    assert frame.ids is not None
    grid = identity_grid(task, state.step, frame.ids.numel())
    logits = classify(features[:, *grid].flatten(1).T, state.shared)
    return identity_loss(logits, classes_of(frame.ids[grid].reshape(-1), task.names))


def with_identity(state: State, weights: LossWeights) -> Gaussians:
    """The splats of a step, without features in steps that have no L_o."""
    gaussians = state.gaussians()
    return replace(gaussians, identity=None) if state.step % weights.identity_every else gaussians


def identity_grid(task: Task, step: int, pixels: int) -> tuple[slice, slice]:
    """Rows and columns that L_o looks at in a step: every so many, from a place that the step draws."""
    stride = identity_stride(pixels)
    x, y = torch.randint(0, stride, (2,), generator=generator_of(task.config, 1, step)).tolist()
    return slice(y, None, stride), slice(x, None, stride)


def identity_stride(pixels: int) -> int:
    """Every how many pixels, across and down, L_o looks at one: the fewest that keep to the budget."""
    return math.ceil(math.sqrt(pixels / _IDENTITY_PIXELS))


def classes_of(ids: Int16[Tensor, "p"], names: list[int]) -> Int16[Tensor, "p"]:
    """Places of ids in the ascending `names`; UNLABELLED for an id that is not there."""
    known = torch.tensor(names, dtype=torch.int16)
    place = torch.searchsorted(known, ids).clamp_max(len(names) - 1)
    return torch.where(known[place] == ids, place, UNLABELLED).to(torch.int16)
