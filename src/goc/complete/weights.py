"""Networks on disk: safetensors with the sizes in the header, so that a file is enough to build what it holds."""

from dataclasses import asdict, replace
from importlib import resources
from pathlib import Path

import msgspec
import torch
from torch import Tensor

from goc.complete.lite import LiteConfig, OscLite
from goc.complete.osc import Osc, OscConfig
from goc.complete.partial import CHANNELS
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


_READ_BY = {"stem.weight": 1, "to_logit.0.weight": 1}
"""Weights of OSC-lite that read the evidence, and along which axis; its channels come first."""


def begin_from(network: Network, path: Path) -> None:
    """Give a network the weights of a file; inputs that these know nothing of begin with weight 0.

    Raises:
        CompleteError: the file holds another network, by more than hints that it lacks.
    """
    old = load_network(path)
    lite = isinstance(old, OscLite) and isinstance(network, OscLite)
    same = replace(old.config, hints=network.config.hints) if lite else old.config
    if same != network.config or (lite and old.config.hints and not network.config.hints):
        raise CompleteError(f"{path}: holds another network than the one to train. Pass weights of the same size.")
    found = old.state_dict()
    for name, axis in _READ_BY.items() if lite else ():
        first, rest = found[name].tensor_split([len(CHANNELS)], axis)
        missing = network.state_dict()[name].shape[axis] - found[name].shape[axis]
        shape = [missing if dim == axis else size for dim, size in enumerate(found[name].shape)]
        found[name] = torch.cat([first, torch.zeros(shape), rest], axis)
    network.load_state_dict(found)
