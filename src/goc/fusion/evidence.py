"""The evidence grid of an object: which voxels hold seen surface, are seen empty, or are unknown."""

import numpy as np
from jaxtyping import Float32, Float64, Int64, Shaped, UInt8

from goc.fusion.config import FusionConfig
from goc.fusion.detail import Detail
from goc.fusion.volume import BLOCK, BlockGrid, Volume
from goc.scene import Evidence, EvidenceGrid

_KNOWN_LAYER = 0.25
"""Share of an outer layer of the box that rays must have crossed for it to be worth keeping."""


def evidence_block_grid(
    points: Float32[np.ndarray, "v 3"], units_per_metre: float, config: FusionConfig, detail: Detail | None = None
) -> BlockGrid:
    """Box of voxels round an object's measured points: padded, at least `evidence_cells` along its longest side.

    Large objects get more, up to twice as many, until voxels are those of their mesh: completion keeps the measured
    surface where it is, and can do so only as finely as this. Voxels are no finer than pixels and noise are (`detail`).
    The band stays wide, other than that of the open mesh: behind a narrow one, rays that pass beside a silhouette carve
    pits into what is solid.
    """
    pad = config.evidence_pad * units_per_metre
    low, high = _extent(points)
    low, high = low - pad, high + pad
    longest = float((high - low).max())
    finest = config.finest_voxel * units_per_metre if detail is None else detail.finest(config, units_per_metre)
    wanted = min(config.object_voxel * units_per_metre, longest / config.evidence_cells)
    voxel = max(wanted, longest / (2 * config.evidence_cells), finest)
    shape = -(-np.ceil((high - low) / voxel).astype(np.int64) // BLOCK)
    blocks = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    return BlockGrid(
        origin=low + voxel / 2,
        voxel=voxel,
        truncation=config.truncation_voxels * voxel,
        blocks=blocks.astype(np.int32),
    )


def evidence_grid(volume: Volume, points: Float32[np.ndarray, "v 3"], config: FusionConfig) -> EvidenceGrid:
    """Read the votes of a box that every view was fused into.

    FusedSurface: rays of the object's own pixels ended within the truncation, and rays that passed do not outvote them.
    Empty: some ray passed through, whatever id its pixel has, or most rays that ended here ended on another id.
    Unknown: everything else. Of the padding round the object's measured points, what lies behind a layer that no ray
    crossed is cut off, such as what is below the floor.

    Returns:
        origin, voxel and sdf in scene units.
    """
    grid = volume.grid
    weight, empty, other = (plane.reshape(-1) for plane in (volume.weight, volume.empty, volume.other))
    state = (empty > 0).view(np.uint8)  # Evidence.EMPTY or UNKNOWN
    low, high = (np.floor((end - grid.origin) / grid.voxel + 0.5).astype(np.int64) for end in _extent(points))
    kept = _known_box(_dense(grid, state), low, high, pad=int(low.min()))
    stopped = np.flatnonzero(other > 0)
    state[stopped[other[stopped] > config.other_votes * weight[stopped]]] = Evidence.EMPTY
    surface = np.flatnonzero(weight > 0)  # few: what follows is for them alone
    surface = surface[
        (other[surface] <= config.other_votes * weight[surface])
        & (empty[surface] <= config.empty_votes * weight[surface])
    ]
    measured = volume.distance_at(surface)
    surface, measured = surface[~np.isnan(measured)], measured[~np.isnan(measured)]
    state[surface] = Evidence.SURFACE
    distance = np.zeros(weight.shape, np.float32)
    distance[surface] = measured
    return EvidenceGrid(
        origin=grid.origin + grid.voxel * np.array([side.start for side in kept]),
        voxel=grid.voxel,
        state=np.ascontiguousarray(_dense(grid, state)[kept]),
        sdf=np.ascontiguousarray(_dense(grid, distance)[kept]),
    )


def _extent(points: Float32[np.ndarray, "v 3"]) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    return points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)


def _known_box(
    passed: UInt8[np.ndarray, "x y z"], low: Int64[np.ndarray, "3"], high: Int64[np.ndarray, "3"], pad: int
) -> tuple[slice, slice, slice]:
    """Grow the box of voxels low … high outwards for as long as rays crossed the next layer, by `pad` at most."""
    sides = []
    for axis in range(3):
        across = tuple(other for other in range(3) if other != axis)
        known = passed.mean(axis=across) >= _KNOWN_LAYER
        first, last = max(int(low[axis]), 0), min(int(high[axis]), len(known) - 1)
        while first > 0 and known[first - 1]:
            first -= 1
        furthest = min(last + pad, len(known) - 1)
        while last < furthest and known[last + 1]:
            last += 1
        sides.append(slice(first, last + 1))
    return tuple(sides)


def _dense(grid: BlockGrid, field: Shaped[np.ndarray, "_"]) -> Shaped[np.ndarray, "x y z"]:
    shape = grid.blocks.max(axis=0) + 1
    cube = field.reshape(*shape, BLOCK, BLOCK, BLOCK).transpose(0, 3, 1, 4, 2, 5)
    return cube.reshape(shape * BLOCK)
