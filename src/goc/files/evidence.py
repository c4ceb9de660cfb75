"""Evidence grids on disk: states compressed, since most voxels are alike; distances of measured voxels only."""

import zlib
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from goc.errors import FileError
from goc.files.tensors import read_tensors, write_tensors
from goc.scene import Evidence, EvidenceGrid

_LEVEL = 1
_MOST_VOXELS = 1 << 31
_TYPES = {
    "origin": (torch.float64, 1),
    "voxel": (torch.float64, 0),
    "shape": (torch.int64, 1),
    "state": (torch.uint8, 1),
    "sdf": (torch.float32, 1),
}
"""Type and number of dimensions of each tensor."""


def write_evidence(path: Path, evidence: EvidenceGrid) -> None:
    """Write a grid as safetensors, atomically.

    Tensors: origin (3), voxel, shape (3); state: the voxels' states as bytes in C order, zlib-compressed; sdf: the
    distances of the SURFACE voxels in that order. Distances elsewhere mean nothing and are read back as 0.
    """
    squeezed = zlib.compress(np.ascontiguousarray(evidence.state).tobytes(), _LEVEL)
    write_tensors(
        path,
        {
            "origin": torch.from_numpy(np.array(evidence.origin, np.float64)),
            "voxel": torch.tensor(evidence.voxel, dtype=torch.float64),
            "shape": torch.tensor(evidence.state.shape, dtype=torch.int64),
            "state": torch.frombuffer(bytearray(squeezed), dtype=torch.uint8),
            "sdf": torch.from_numpy(evidence.sdf[evidence.state == Evidence.SURFACE]),
        },
    )


def read_evidence(path: Path) -> EvidenceGrid:
    """Read what `write_evidence` wrote.

    Raises:
        FileError: missing, damaged, or parts that contradict each other.
    """
    tensors, _ = read_tensors(path)
    _check_tensors(path, tensors)
    origin, voxel, shape = tensors["origin"].numpy(), float(tensors["voxel"]), tuple(tensors["shape"].tolist())
    if len(origin) != 3 or not np.isfinite(origin).all() or not 0 < voxel < np.inf:
        raise FileError(f"{path}: its origin or voxel is no place or length. Write it again.")
    if len(shape) != 3 or min(shape) < 1 or max(shape) > _MOST_VOXELS or np.prod(shape) > _MOST_VOXELS:
        raise FileError(f"{path}: {shape} is no shape of a grid. Write it again.")
    state = _states(path, tensors["state"], int(np.prod(shape))).reshape(shape)
    values, surface = tensors["sdf"].numpy(), state == Evidence.SURFACE
    if len(values) != surface.sum() or not np.isfinite(values).all():
        raise FileError(
            f"{path}: {len(values)} distances for {surface.sum()} surface voxels, or some not finite. Write it again."
        )
    sdf = np.zeros(shape, np.float32)
    sdf[surface] = values
    return EvidenceGrid(origin=origin, voxel=voxel, state=state, sdf=sdf)


def _check_tensors(path: Path, tensors: dict[str, Tensor]) -> None:
    for name, (kind, dimensions) in _TYPES.items():
        found = tensors.get(name)
        if found is None or found.dtype != kind or found.ndim != dimensions:
            raise FileError(f"{path}: tensor {name} is missing or of another kind. Write it again.")


def _states(path: Path, squeezed: Tensor, count: int) -> np.ndarray:
    unpacker = zlib.decompressobj()
    try:
        data = unpacker.decompress(squeezed.numpy().tobytes(), count + 1)  # no more than that, whatever it holds
    except zlib.error as error:
        raise FileError(f"{path}: its states cannot be unpacked ({error}). Write it again.") from error
    if len(data) != count or not unpacker.eof:
        raise FileError(f"{path}: it does not hold the states of {count} voxels. Write it again.")
    state = np.frombuffer(data, np.uint8).copy()
    if state.max() > max(Evidence):
        raise FileError(f"{path}: {(state > max(Evidence)).sum()} voxels are in no known state. Write it again.")
    return state
