"""The mutable state of a training and its file: weights, their moving average, Adam's moments, step, time."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from goc.complete import Network
from goc.errors import TrainError
from goc.files import read_tensors, write_tensors

_MOMENTS = ("exp_avg", "exp_avg_sq")


@dataclass(eq=False)
class TrainState:
    """All that changes from step to step; mutable, used inside one training only."""

    network: Network
    optimiser: torch.optim.AdamW
    average: dict[str, Tensor]
    """Running mean of the weights."""
    step: int = 0
    seconds: float = 0.0
    """Training time so far, over all runs."""

    @torch.no_grad()
    def update_average(self, share: float) -> None:
        """Move the running mean towards the weights: it keeps `share` of itself, less in the first steps."""
        kept = min(share, (1 + self.step) / (10 + self.step))
        own = dict(self.network.named_parameters())
        torch._foreach_lerp_(list(self.average.values()), [own[name] for name in self.average], 1.0 - kept)

    @torch.no_grad()
    def averaged(self, into: Network) -> Network:
        """Put the running mean into a network of the same size."""
        into.load_state_dict(self.average, strict=False)
        return into.eval()


def initial_state(network: Network, rate: float, decay: float) -> TrainState:
    """Training from step 0; norms and biases do not decay."""
    heavy = [p for p in network.parameters() if p.ndim >= 2]
    light = [p for p in network.parameters() if p.ndim < 2]
    groups = [{"params": heavy, "weight_decay": decay}, {"params": light, "weight_decay": 0.0}]
    optimiser = torch.optim.AdamW(groups, lr=rate, betas=(0.9, 0.98))
    average = {name: value.detach().clone() for name, value in network.named_parameters()}
    return TrainState(network=network, optimiser=optimiser, average=average)


def save_state(path: Path, state: TrainState, fingerprint: str) -> None:
    """Write everything the next step depends on, atomically; randomness depends on seed and step alone."""
    tensors = {}
    for name, parameter in state.network.named_parameters():
        tensors[f"weights/{name}"] = parameter.detach()
        tensors[f"average/{name}"] = state.average[name]
        for kind, value in state.optimiser.state.get(parameter, {}).items():
            tensors[f"{kind}/{name}"] = value
    metadata = {"step": str(state.step), "seconds": repr(state.seconds), "fingerprint": fingerprint}
    write_tensors(path, tensors, metadata)


def load_state(path: Path, state: TrainState, fingerprint: str) -> TrainState:
    """Fill a fresh state with what was saved of the same training.

    Raises:
        TrainError: saved by a training with other settings, or damaged.
    """
    tensors, metadata = read_tensors(path)
    if metadata.get("fingerprint") != fingerprint:
        raise TrainError(
            f"{path}: belongs to a training with other settings. Repeat them, or train into another folder."
        )
    try:
        with torch.no_grad():
            for name, parameter in state.network.named_parameters():
                parameter.copy_(tensors[f"weights/{name}"])
                state.average[name].copy_(tensors[f"average/{name}"])
                if f"step/{name}" in tensors:
                    moments = {kind: tensors[f"{kind}/{name}"].to(parameter.device) for kind in _MOMENTS}
                    state.optimiser.state[parameter] = {"step": tensors[f"step/{name}"], **moments}
        state.step, state.seconds = int(metadata["step"]), float(metadata["seconds"])
    except (KeyError, RuntimeError, ValueError) as error:
        raise TrainError(f"{path}: lacks a part of the training ({error}). Train into another folder.") from error
    return state
