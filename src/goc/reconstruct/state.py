"""State of an optimisation (parameters, Adam's moments, step number), and its checkpoints on disk."""

from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from goc.errors import ReconstructError
from goc.files import read_tensors, write_tensors
from goc.scene.gaussians import Gaussians

_SHARED = "classifier."
"""Prefix of the names of parameters that all splats share."""


@dataclass(eq=False)
class State:
    """Mutable state of one optimisation; its result is read with `gaussians`."""

    parameters: dict[str, Tensor]
    """By name. One row a splat, as in Gaussians: means, quats, log_scales, opacity_logits, sh, identity.
    Shared by all splats: names that start with "classifier."."""
    first: dict[str, Tensor]
    second: dict[str, Tensor]
    step: int = 0
    views: dict[str, Tensor] = field(default_factory=dict)
    """Tensors about views that later steps read, by name. Checkpoints keep them; they are not optimised."""

    @property
    def per_splat(self) -> list[str]:
        """Names of the parameters with one row a splat."""
        return [name for name in self.parameters if not name.startswith(_SHARED)]

    @property
    def splats(self) -> int:
        """Number of splats."""
        return len(self.parameters["means"])

    @property
    def shared(self) -> dict[str, Tensor]:
        """Parameters of the classifier, by their names in it; empty when labels are voted."""
        return {
            name.removeprefix(_SHARED): self.parameters[name] for name in self.parameters if name.startswith(_SHARED)
        }

    def gaussians(self) -> Gaussians:
        """The splats as they are now, sharing memory and autograd graph."""
        p = self.parameters
        return Gaussians(
            means=p["means"],
            quats=p["quats"],
            log_scales=p["log_scales"],
            opacity_logits=p["opacity_logits"],
            sh=p["sh"],
            identity=p.get("identity"),
        )

    def to(self, device: torch.device) -> "State":
        """Return the state with parameters and moments on a device; `views` stays where it is."""
        parameters = {name: value.detach().to(device).requires_grad_() for name, value in self.parameters.items()}
        first, second = ({name: value.to(device) for name, value in m.items()} for m in (self.first, self.second))
        return State(parameters=parameters, first=first, second=second, step=self.step, views=self.views)

    def resize(self, source: Tensor) -> None:
        """Set row i of every per-splat parameter to row source[i]. Moments of added rows are zero."""
        kept = len(self.parameters["means"])
        for name in self.per_splat:
            rows = self.parameters[name].detach()[source].contiguous()
            self.parameters[name] = rows.requires_grad_()
            for moments in (self.first, self.second):
                grown = torch.zeros_like(rows)
                grown[:kept] = moments[name]
                moments[name] = grown

    def forget(self, rows: Tensor) -> None:
        """Zero Adam's moments of the given splats."""
        for name in self.per_splat:
            self.first[name][rows] = 0.0
            self.second[name][rows] = 0.0


def initial_state(gaussians: Gaussians, shared: dict[str, Tensor]) -> State:
    """State at step 0 from splats and shared parameters, which are copied; all moments are zero."""
    parameters = {
        "means": gaussians.means,
        "quats": gaussians.quats,
        "log_scales": gaussians.log_scales,
        "opacity_logits": gaussians.opacity_logits,
        "sh": gaussians.sh,
    }
    if gaussians.identity is not None:
        parameters["identity"] = gaussians.identity
    parameters |= {_SHARED + name: value for name, value in shared.items()}
    parameters = {name: value.detach().clone().contiguous().requires_grad_() for name, value in parameters.items()}
    zeros = [{name: torch.zeros_like(value, requires_grad=False) for name, value in parameters.items()} for _ in "12"]
    return State(parameters=parameters, first=zeros[0], second=zeros[1])


def save_checkpoint(path: Path, state: State, fingerprint: str) -> None:
    """Write the whole state atomically. Random numbers need no state: they depend on seed and step alone."""
    tensors = {}
    for kind in ("parameters", "first", "second", "views"):
        tensors |= {f"{kind}/{name}": value.detach().cpu() for name, value in getattr(state, kind).items()}
    write_tensors(path, tensors, {"step": str(state.step), "fingerprint": fingerprint})


def load_checkpoint(path: Path, fingerprint: str) -> State:
    """Read a checkpoint, whose fingerprint of capture and settings has to match.

    Raises:
        ReconstructError: the fingerprint differs, or a tensor is missing.
    """
    tensors, metadata = read_tensors(path)
    if metadata.get("fingerprint") != fingerprint:
        raise ReconstructError(
            f"{path}: made from another capture or with other settings. "
            "Repeat the command that made it, or leave out --resume to start again."
        )
    kinds: dict[str, dict[str, Tensor]] = {"parameters": {}, "first": {}, "second": {}, "views": {}}
    for key, value in tensors.items():
        kind, _, name = key.partition("/")
        kinds.setdefault(kind, {})[name] = value
    if not set(kinds["parameters"]) == set(kinds["first"]) == set(kinds["second"]) or "step" not in metadata:
        raise ReconstructError(f"{path}: parameters and moments do not match. Leave out --resume to start again.")
    parameters = {name: value.requires_grad_() for name, value in kinds["parameters"].items()}
    return State(
        parameters=parameters,
        first=kinds["first"],
        second=kinds["second"],
        step=int(metadata["step"]),
        views=kinds["views"],
    )
