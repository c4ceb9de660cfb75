"""What was measured in a box round an object: surface seen, seen empty, unknown."""

import numpy as np
from jaxtyping import Float32

from goc.extract.config import ExtractConfig
from goc.extract.fuse import voted_distance
from goc.extract.volume import BLOCK, Lattice, Volume
from goc.scene import Evidence, EvidenceGrid


def evidence_lattice(points: Float32[np.ndarray, "v 3"], unit: float, config: ExtractConfig) -> Lattice:
    """Box of voxels round an object's measured points: padded, `evidence_cells` along its longest side."""
    pad = config.evidence_pad * unit
    low, high = points.min(axis=0).astype(np.float64) - pad, points.max(axis=0).astype(np.float64) + pad
    voxel = float((high - low).max()) / config.evidence_cells
    shape = -(-np.ceil((high - low) / voxel).astype(np.int64) // BLOCK)
    blocks = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    return Lattice(
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
    return EvidenceGrid(origin=volume.lattice.origin, voxel=volume.lattice.voxel, state=_dense(volume, state), sdf=_dense(volume, sdf))


def _dense(volume: Volume, field: Float32[np.ndarray, "b 8 8 8"] | np.ndarray) -> np.ndarray:
    shape = volume.lattice.blocks.max(axis=0) + 1
    cube = field.reshape(*shape, BLOCK, BLOCK, BLOCK).transpose(0, 3, 1, 4, 2, 5)
    return np.ascontiguousarray(cube.reshape(shape * BLOCK))
