"""What was measured in a box round an object: surface seen, seen empty, unknown."""

import numpy as np
from jaxtyping import Float32, Int32

from goc.extract.config import ExtractConfig
from goc.extract.fuse import voted_distance
from goc.extract.volume import BLOCK, Volume
from goc.scene import Evidence, EvidenceGrid


def evidence_volume(cells: Int32[np.ndarray, "n 3"], size: float, unit: float, config: ExtractConfig) -> Volume:
    """An empty box of voxels round an object's cells, padded, its longest side `evidence_cells` long."""
    pad = config.evidence_pad * unit
    low, high = cells.min(axis=0) * size - pad, (cells.max(axis=0) + 1) * size + pad
    voxel = float((high - low).max()) / config.evidence_cells
    shape = -(-np.ceil((high - low) / voxel).astype(np.int64) // BLOCK)
    blocks = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    return Volume(
        origin=low + voxel / 2,
        voxel=voxel,
        truncation=config.truncation_voxels * voxel,
        blocks=blocks.astype(np.int32),
    )


def evidence_grid(volume: Volume, config: ExtractConfig) -> EvidenceGrid:
    """Read the votes of a box that every view was fused into.

    Empty: some ray passed through it, whatever id its pixel has. Surface: a ray of the object's own pixels ended within
    the truncation, and rays that passed do not outvote it. Unknown: everything else, other things' insides among it.

    Returns:
        origin, voxel and sdf in scene units.
    """
    distance = voted_distance(volume, config)
    carved = volume.empty > config.empty_votes * volume.weight
    is_surface = ~np.isnan(distance) & ~carved
    state = np.where(volume.empty > 0, Evidence.EMPTY, Evidence.UNKNOWN).astype(np.uint8)
    state = np.where(is_surface, np.uint8(Evidence.SURFACE), state)
    sdf = np.where(is_surface, distance, np.float32(0.0))
    return EvidenceGrid(origin=volume.origin, voxel=volume.voxel, state=_dense(volume, state), sdf=_dense(volume, sdf))


def _dense(volume: Volume, field: Float32[np.ndarray, "b 8 8 8"] | np.ndarray) -> np.ndarray:
    shape = volume.blocks.max(axis=0) + 1
    cube = field.reshape(*shape, BLOCK, BLOCK, BLOCK).transpose(0, 3, 1, 4, 2, 5)
    return np.ascontiguousarray(cube.reshape(shape * BLOCK))
