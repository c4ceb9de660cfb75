"""Sparse blocks of voxels that depth images are fused into, and the surface in them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64

from goc import _native
from goc.fusion.depth_views import DepthView
from goc.geometry.native_camera import native_camera
from goc.scene import Mesh

BLOCK = 8
DISTANCE, WEIGHT, VIEWS, OTHER, EMPTY, RED = range(6)
"""Places of the sums in `Volume.sums`, as native/fuse.cpp has them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockGrid:
    """Voxel (i, j, k) is centred at origin + voxel · (i, j, k), world; block b holds voxels 8 b … 8 b + 7."""

    origin: Float64[np.ndarray, "3"]
    voxel: float
    truncation: float
    blocks: Int32[np.ndarray, "b 3"]


class Volume:
    """A block grid with the sums that views are fused into; mutable."""

    def __init__(self, grid: BlockGrid) -> None:
        self.grid = grid
        shape = (_native.FUSE_SUMS, len(grid.blocks), BLOCK, BLOCK, BLOCK)
        self.sums: Float32[np.ndarray, "s b 8 8 8"] = np.zeros(shape, np.float32)

    def add(self, view: DepthView, wanted: int | None) -> None:
        """Fuse one view; only pixels of id `wanted` are surface, None takes all. Rays that pass vote empty."""
        at = self.grid
        grid = np.array([*at.origin, at.voxel, at.truncation], np.float64)
        ids = None if wanted is None else view.ids
        _native.fuse_view(
            grid,
            at.blocks,
            view.depth,
            view.slope,
            view.colours,
            native_camera(view.camera),
            ids,
            wanted or 0,
            self.sums,
        )

    @property
    def weight(self) -> Float32[np.ndarray, "b 8 8 8"]:
        """Σ cos θ / z² of the rays that ended in the band, faded behind the surface."""
        return self.sums[WEIGHT]

    @property
    def views(self) -> Float32[np.ndarray, "b 8 8 8"]:
        """Number of views whose ray ended in the band."""
        return self.sums[VIEWS]

    @property
    def other(self) -> Float32[np.ndarray, "b 8 8 8"]:
        """Σ cos θ / z² of the rays that ended in the band on another id."""
        return self.sums[OTHER]

    @property
    def empty(self) -> Float32[np.ndarray, "b 8 8 8"]:
        """Σ cos θ / z² of the rays that passed through the voxel."""
        return self.sums[EMPTY]

    def distance(self) -> Float32[np.ndarray, "b 8 8 8"]:
        """Mean signed distance of the rays that ended in the band; NaN where none did."""
        weight = self.weight
        mean = self.sums[DISTANCE] / np.where(weight > 0, weight, 1)
        return np.where(weight > 0, mean, np.float32(np.nan))

    def distance_at(self, voxels: Int64[np.ndarray, "n"]) -> Float32[np.ndarray, "n"]:
        """Mean signed distance at voxels whose weight is above 0, by their flat index."""
        return self.sums[DISTANCE].reshape(-1)[voxels] / self.weight.reshape(-1)[voxels]

    def colours_at(self, voxels: Int64[np.ndarray, "n"]) -> Float32[np.ndarray, "n 3"]:
        """Mean colour, 0 … 255, of voxels by their index among all; 0 where nothing was seen."""
        weight = self.weight.reshape(-1)[voxels]
        planes = self.sums[RED:].reshape(3, -1)
        return np.stack([plane[voxels] for plane in planes], axis=1) / np.where(weight > 0, weight, 1)[:, None]


@dataclass(frozen=True, kw_only=True, eq=False)
class FusedSurface:
    """A fused mesh, with weight and agreement of the rays at each vertex."""

    mesh: Mesh
    weight: Float32[np.ndarray, "v"]
    """Smaller of the weights at the two voxels the vertex lies between."""
    agreement: Float32[np.ndarray, "v"]
    """Share of rays that support the vertex among all that reached its two voxels, 0 … 1."""


def fused_surface(volume: Volume, values: Float32[np.ndarray, "b 8 8 8"]) -> FusedSurface:
    """Mesh the zero level of `values` (positive outside, NaN = leave open), one vertex a grid edge."""
    edges, share, positions, faces = _crossed(volume.grid, values)
    inner, outer = volume.colours_at(edges[:, 0]), volume.colours_at(edges[:, 1])
    colours = inner + (outer - inner) * share
    own = volume.weight.reshape(-1)[edges]
    against = volume.other.reshape(-1)[edges] + volume.empty.reshape(-1)[edges]
    return FusedSurface(
        mesh=Mesh(
            vertices=positions,
            faces=faces,
            colours=np.clip(np.rint(colours), 0, 255).astype(np.uint8),
        ),
        weight=own.min(axis=1),
        agreement=own.sum(axis=1) / np.maximum(own.sum(axis=1) + against.sum(axis=1), np.float32(1e-12)),
    )


def zero_level(
    grid: BlockGrid, values: Float32[np.ndarray, "b 8 8 8"]
) -> tuple[Float32[np.ndarray, "v 3"], Int32[np.ndarray, "t 3"]]:
    """Vertices and faces of the zero level of `values` (positive outside, NaN = leave open), without colours."""
    _, _, positions, faces = _crossed(grid, values)
    return positions, faces


def _crossed(
    grid: BlockGrid, values: Float32[np.ndarray, "b 8 8 8"]
) -> tuple[Int64[np.ndarray, "v 2"], Float64[np.ndarray, "v 1"], Float32[np.ndarray, "v 3"], Int32[np.ndarray, "t 3"]]:
    """BlockGrid edges that the zero level crosses, by their two voxels; how far along; where that is; and the faces."""
    nudge = np.float32(1e-3 * grid.voxel)  # a vertex on a voxel would make triangles without area
    values = np.where(np.abs(values) < nudge, nudge, values)
    edges, faces = _native.isosurface(grid.blocks, values)
    ends = values.reshape(-1)[edges].astype(np.float64)
    share = ends[:, :1] / (ends[:, :1] - ends[:, 1:])
    block, offset = np.divmod(edges, BLOCK**3)
    index = grid.blocks[block] * BLOCK + np.stack(np.unravel_index(offset, (BLOCK,) * 3), axis=-1)
    positions = grid.origin + grid.voxel * (index[:, 0] + (index[:, 1] - index[:, 0]) * share)
    return edges.view(np.int64), share, positions.astype(np.float32), faces


def blocks_near(
    cells: Int32[np.ndarray, "n 3"], size: float, origin: Float64[np.ndarray, "3"], voxel: float, reach: float
) -> Int32[np.ndarray, "b 3"]:
    """Blocks of a grid that hold any voxel within `reach` (box norm) of the given cells of edge `size`."""
    edge = BLOCK * voxel
    low = np.floor((cells * size - reach - origin) / edge).astype(np.int64)
    high = np.floor(((cells + 1) * size + reach - origin) / edge).astype(np.int64)
    found = []
    for step in np.ndindex(*(high - low).max(axis=0) + 1) if len(cells) else ():
        block = low + step
        found.append(np.unique(block[(block <= high).all(axis=1)], axis=0))
    return np.unique(np.concatenate(found), axis=0).astype(np.int32) if found else np.zeros((0, 3), np.int32)
