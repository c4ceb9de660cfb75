"""Networks on disk: safetensors with the sizes in the header, so that a file is enough to build what it holds."""

from dataclasses import asdict
from importlib import resources
from pathlib import Path

import msgspec
import torch
from torch import Tensor

from goc.complete.lite import LiteConfig, OscLite
from goc.complete.osc import Osc, OscConfig
from goc.errors import CompleteError
from goc.files import is_file, read_tensors, write_tensors

Network = Osc | OscLite

SHIPPED = Path(str(resources.files("goc.complete"))) / "weights" / "osc_lite.safetensors"
"""Weights of OSC-lite inside the package."""


def build(config: OscConfig | LiteConfig, seed: int = 0) -> Network:
    """An untrained network; the same for the same seed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return Osc(config) if isinstance(config, OscConfig) else OscLite(config)


def save_network(path: Path, network: Network, notes: dict[str, str] | None = None, half: bool = False) -> None:
    """Write a network's weights; `notes` (where they come from) go into the header. `half` stores float16."""
    kind = "osc" if isinstance(network, Osc) else "lite"
    metadata = {**(notes or {}), "kind": kind, "config": msgspec.json.encode(asdict(network.config)).decode()}
    tensors = {name: _stored(value, half) for name, value in network.state_dict().items()}
    write_tensors(path, tensors, metadata)


def _stored(value: Tensor, half: bool) -> Tensor:
    return value.half() if half else value


def load_network(path: Path = SHIPPED) -> Network:
    """Read a network, ready to complete: float32, on the CPU, in evaluation mode.

    Raises:
        FileError: missing or damaged.
        CompleteError: a file of something else, or of other sizes than its header says.
    """
    if path == SHIPPED and not is_file(path):
        raise CompleteError(f"{path}: goc was packaged without weights. Pass weights that `goc osc train` made.")
    tensors, metadata = read_tensors(path)
    try:
        config = msgspec.json.decode(
            metadata["config"].encode(), type={"osc": OscConfig, "lite": LiteConfig}[metadata["kind"]]
        )
        network = build(config)
        network.load_state_dict({name: value.float() for name, value in tensors.items()})
    except (KeyError, RuntimeError, msgspec.DecodeError) as error:
        first = str(error).splitlines()[0]
        raise CompleteError(f"{path}: no weights of a completion network ({first}). Train them again.") from error
    return network.eval()
