"""What pulls splats towards transparency and smallness (Kheradmand et al. 2024), straight into their gradients."""

import torch
from torch import Tensor

from goc import _native
from goc.reconstruct import kernels
from goc.reconstruct.config import Mcmc


@torch.no_grad()
def add_penalties(logits: Tensor, log_scales: Tensor, config: Mcmc) -> None:
    """Add the gradients of the mean opacity and the mean size of the splats in view to those that they have.

    Those in view are the splats with a gradient; others would melt away (measured: gsplat #778). Nothing happens where
    there are no gradients.

    Args:
        logits: of the opacities, (n), with gradients.
        log_scales: (n 3), with gradients.
        config: what a unit of either is worth.
    """
    if logits.grad is None or log_scales.grad is None:
        return
    weights = config.opacity_penalty, config.scale_penalty
    if kernels.natively(logits):
        _native.add_penalties(logits.detach(), log_scales.detach(), *weights, logits.grad, log_scales.grad)
        return
    seen = (logits.grad != 0).to(logits.dtype)
    each = seen / seen.sum().clamp_min(1.0)
    opacities = logits.sigmoid()
    logits.grad.add_(each * opacities * (1.0 - opacities), alpha=weights[0])
    log_scales.grad.add_(each[:, None] * log_scales.exp(), alpha=weights[1] / 3.0)
