"""Eq. (6) of one view."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from goc.raster import blend_view
from goc.reconstruct.depth import rendered_depth
from goc.reconstruct.labels import classify
from goc.reconstruct.losses import geometry_loss, identity_loss, photometric_loss
from goc.reconstruct.pair_loss import pair_loss
from goc.reconstruct.state import State
from goc.reconstruct.task import Task, generator_of
from goc.scene.capture import Frame

IDENTITY_PIXELS = 16_384
"""Pixels a step whose features are classified: all of them would make the MLP dearer than the view."""


def view_loss(task: Task, state: State, view: int) -> tuple[Float[Tensor, ""], float]:
    """Eq. (6) of one view, and its PSNR in dB."""
    frame = task.capture[view]
    weights, camera = task.config.losses, frame.camera
    shown = blend_view(state.gaussians(), camera, planes=task.config.depth == "plane")
    loss, error = photometric_loss(shown.colour, frame.image, weights.ssim)
    depth = rendered_depth(shown.geometry, shown.alpha, camera)
    if weights.depth or weights.depth_normal:
        prior = task.prior(view, state.views, depth, state.step // len(task.views))
        if prior is not None:
            loss = loss + geometry_loss(depth, prior, camera, weights.depth / task.capture.unit, weights.depth_normal)
    if task.pairs is not None:
        loss = loss + pair_loss(task, task.pairs, state, view, depth)
    if shown.features is not None and frame.ids is not None and weights.identity:
        loss = loss + weights.identity * _identity_loss(task, state, shown.features, frame)
    return loss, -10.0 * math.log10(max(error, 1e-10))


def _identity_loss(task: Task, state: State, features: Float[Tensor, "f h w"], frame: Frame) -> Float[Tensor, ""]:
    assert frame.ids is not None
    classes = torch.full_like(frame.ids, -1)
    for place, name in enumerate(task.names):
        classes[frame.ids == name] = place
    pixels = torch.randint(0, classes.numel(), (IDENTITY_PIXELS,), generator=generator_of(task.config, 1, state.step))
    logits = classify(features.flatten(1)[:, pixels].T, state.shared)
    return identity_loss(logits, classes.reshape(-1)[pixels])
