"""What completion networks are trained for, paper §5.2: Eq. (11) to (16)."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from goc.settings import Amount, OpenShare, Positive, Settings

T_ISO = 1.0 / 128.0
"""Half width of the band in which labels are smooth, model units."""


@dataclass(frozen=True, kw_only=True)
class LossConfig(Settings):
    """Weights of the terms, Eq. (16), and how a hard threshold gets a gradient."""

    bce: Amount = 1.0
    """Weight of the binary cross-entropy."""
    iou: Amount = 0.01
    """Weight of 1 - IoU."""
    kl: Amount = 1e-4
    """Weight of the KL divergence of the latent; OSC-lite has none."""
    threshold: OpenShare = 0.3
    """T_b: occupancy above which a point counts as inside."""
    softness: Positive = 0.05
    """Width of the soft threshold: sigmoid((p - T_b) / softness)."""
    iou_state: Literal["soft", "straight-through"] = "soft"
    """soft: IoU of soft states. straight-through: IoU of hard states, with the gradient of the soft ones."""


def smooth_occupancy(distance: Float[Tensor, "*shape"], band: float = T_ISO) -> Float[Tensor, "*shape"]:
    """Labels O_s, Eq. (11) and (12): 1 inside, 0 outside, linear within `band` of the surface.

    Args:
        distance: signed, model units, negative inside.
        band: T_iso, model units.
    """
    return (0.5 - 0.5 * distance / band).clamp(0.0, 1.0)


def occupancy_loss(logits: Float[Tensor, "b q"], distance: Float[Tensor, "b q"]) -> Float[Tensor, ""]:
    """L_BCE, Eq. (13): mean binary cross-entropy against smooth labels."""
    return functional.binary_cross_entropy_with_logits(logits, smooth_occupancy(distance))


def iou_loss(logits: Float[Tensor, "b q"], distance: Float[Tensor, "b q"], config: LossConfig) -> Float[Tensor, ""]:
    """L_IoU, Eq. (14) and (15): 1 - IoU of the states at threshold T_b with the unsmoothed truth, mean over objects.

    As printed its gradient is 0 everywhere; see `LossConfig.iou_state` and docs/decisions.
    """
    occupancy = logits.sigmoid()
    state = ((occupancy - config.threshold) / config.softness).sigmoid()
    if config.iou_state == "straight-through":
        state = (occupancy > config.threshold).float() + state - state.detach()
    truth = (distance < 0).float()
    shared = (state * truth).sum(-1)
    either = (state + truth - state * truth).sum(-1)
    return (1.0 - shared / either.clamp_min(1e-6)).mean()


def completion_loss(
    logits: Float[Tensor, "b q"],
    divergence: Float[Tensor, ""],
    distance: Float[Tensor, "b q"],
    config: LossConfig,
) -> dict[str, Float[Tensor, ""]]:
    """Eq. (16): the terms, and under "loss" their weighted sum."""
    terms = {"bce": occupancy_loss(logits, distance), "iou": iou_loss(logits, distance, config)}
    terms["kl"] = divergence
    total = config.bce * terms["bce"] + config.iou * terms["iou"] + config.kl * terms["kl"]
    return {"loss": total, **terms}


@torch.no_grad()
def hard_iou(logits: Float[Tensor, "b q"], distance: Float[Tensor, "b q"], threshold: float) -> Float[Tensor, "b"]:
    """IoU of thresholded occupancy with the truth over the given points, an object each."""
    state, truth = logits.sigmoid() > threshold, distance < 0
    return (state & truth).sum(-1) / (state | truth).sum(-1).clamp_min(1)
