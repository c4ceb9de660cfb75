"""L_o, Eq. (7): learned instance features against ids."""

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc.scene.capture import UNLABELLED


def identity_loss(logits: Float[Tensor, "v p k"], classes: Int16[Tensor, "v p"]) -> Float[Tensor, ""]:
    """Cross-entropy between predicted and given instance, mean over labelled pixels and views; 0 where none is.

    In PyTorch on every device: the classifier's matrices are all there is to compute.
    """
    each = torch.nn.functional.cross_entropy(
        logits.flatten(0, 1), classes.long().flatten(), ignore_index=UNLABELLED, reduction="none"
    )
    return (each.view(classes.shape).sum(1) / (classes != UNLABELLED).sum(1).clamp_min(1)).mean()


def classes_of(ids: Int16[Tensor, "*s"], known: Int16[Tensor, "k"]) -> Int16[Tensor, "*s"]:
    """Places of ids in the ascending ids that are told apart; UNLABELLED for an id that is not there."""
    ids = ids.contiguous()
    place = torch.searchsorted(known, ids).clamp_max(len(known) - 1)
    return torch.where(known[place] == ids, place, UNLABELLED).to(torch.int16)
