"""Input and output of completion: a partial object, and an occupancy field, both in the frame of a cube."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int64, UInt8
from torch import Tensor

from goc.complete.hints import hint_channels
from goc.scene import Evidence, EvidenceGrid

SIDE = 1.25
"""Side of the cube in longest sides of the seen box: room for what was not seen."""

CHANNELS = ("distance", "surface", "empty", "beyond")
"""What `evidence_channels` tells of a cell: signed distance to the seen surface, share of the cell in its band, share
that rays passed, share that lies beyond the evidence grid. What is left of the cell is unknown."""

_BAND = 1.5
"""Distance, in cells, at which the channel of distances saturates."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cube:
    """The frame that completion works in: [-1, 1]³, axes parallel to the world's. Scale and place, no rotation."""

    centre: Float64[np.ndarray, "3"]
    """Centre of the cube, world."""
    side: float
    """Length of a side, world units."""

    def model_from_world(self, points: Float[np.ndarray, "p 3"]) -> Float32[np.ndarray, "p 3"]:
        """World positions in the cube's frame."""
        return ((points - self.centre) / (self.side / 2)).astype(np.float32)

    def world_from_model(self, points: Float[np.ndarray, "p 3"]) -> Float32[np.ndarray, "p 3"]:
        """Positions in the cube's frame, in the world."""
        return (points * (self.side / 2) + self.centre).astype(np.float32)


def bounding_cube(points: Float[np.ndarray, "p 3"], side: float = SIDE) -> Cube:
    """The cube round the box of the seen points, its side `side` times the longest side of that box.

    Raises:
        ValueError: no points, points that are not finite, or all in one place.
    """
    if len(points) == 0 or not np.isfinite(points).all():
        raise ValueError(f"A cube needs finite points to go round; got {len(points)} points.")
    low, high = points.min(0).astype(np.float64), points.max(0).astype(np.float64)
    longest = float((high - low).max())
    if not longest > 0:
        raise ValueError("All points are in one place: an object needs some size.")
    return Cube(centre=(low + high) / 2, side=side * longest)


@dataclass(frozen=True, kw_only=True, eq=False)
class PartialObject:
    """What was measured of an object, in the frame of its cube: model units, in which the cube is [-1, 1]³."""

    points: Float32[np.ndarray, "p 3"]
    """On the seen surface."""
    normals: Float32[np.ndarray, "p 3"]
    """Unit, outwards; zero where unknown."""
    evidence: EvidenceGrid
    """Seen surface, seen-empty and unknown voxels around it; origin, voxel and sdf in model units."""


def partial_object(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"] | None,
    evidence: EvidenceGrid,
    cube: Cube,
) -> PartialObject:
    """Bring what was measured in the world into the frame of a cube."""
    scale = 2.0 / cube.side
    moved = EvidenceGrid(
        origin=(evidence.origin - cube.centre) * scale,
        voxel=evidence.voxel * scale,
        state=evidence.state,
        sdf=(evidence.sdf * np.float32(scale)).astype(np.float32),
    )
    unit = np.zeros_like(points) if normals is None else normals
    return PartialObject(points=cube.model_from_world(points), normals=unit.astype(np.float32), evidence=moved)


@runtime_checkable
class OccupancyField(Protocol):
    """A model's occupancy of one object: log-odds that a point of the cube lies inside."""

    def logits(self, points: Float[Tensor, "q 3"]) -> Float[Tensor, "q"]:
        """Log-odds of occupancy at points in model units, [-1, 1]³; the sigmoid is the paper's Ô_s, Eq. (10)."""
        ...


@runtime_checkable
class Completer(Protocol):
    """Any model that completes an object from a partial one."""

    def complete(self, partial: PartialObject) -> OccupancyField:
        """The whole object, as far as the model can tell, from the part that was seen."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class PartialBatch:
    """b partial objects as the networks take them, model units. A network may leave out what it does not use."""

    points: Float[Tensor, "b p 3"]
    normals: Float[Tensor, "b p 3"]
    evidence: Float[Tensor, "b c n n n"]
    """CHANNELS, and HINTS for networks that take them, on a grid of n³ cells that fills the cube."""

    def to(self, device: torch.device | str) -> "PartialBatch":
        """The same on another device."""
        return PartialBatch(
            points=self.points.to(device), normals=self.normals.to(device), evidence=self.evidence.to(device)
        )


def batch_of(partial: PartialObject, points: int, cells: int, hints: bool = False) -> PartialBatch:
    """One partial object as a batch: `points` of its points, and its evidence on `cells`³ cells, with hints or not."""
    chosen = spread_rows(len(partial.points), points)
    return PartialBatch(
        points=torch.from_numpy(partial.points[chosen])[None],
        normals=torch.from_numpy(partial.normals[chosen])[None],
        evidence=torch.from_numpy(evidence_channels(partial.evidence, cells, hints))[None],
    )


def spread_rows(available: int, wanted: int) -> Int64[np.ndarray, "{wanted}"]:
    """Rows of a shuffled list, as many as wanted: without repetition where there are enough, else in rounds.

    Raises:
        ValueError: some are wanted and none are there.
    """
    if wanted and not available:
        raise ValueError("No points were seen: there is nothing to complete.")
    random = np.random.default_rng(0)
    rounds = [random.permutation(available) for _ in range(-(-wanted // max(available, 1)))]
    return np.concatenate([np.zeros(0, np.int64), *rounds])[:wanted]


def cell_centres(cells: int) -> Float32[np.ndarray, "n n n 3"]:
    """Centres of the cells that evidence is put on, model units."""
    axis = ((np.arange(cells) + 0.5) * (2.0 / cells) - 1.0).astype(np.float32)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)


def evidence_channels(
    evidence: EvidenceGrid, cells: int, hints: bool = False
) -> Float32[np.ndarray, "c {cells} {cells} {cells}"]:
    """Evidence on the grid of a network: CHANNELS, and if wanted HINTS.

    Training and completion both come through here, so that the network meets nothing that it was not trained on.

    Args:
        evidence: in model units.
        cells: along each side of the cube.
        hints: whether HINTS follow.

    Returns:
        distance in [-1, 1] in units of 1.5 cells, 0 where no surface was seen; the others are shares in [0, 1]; for
        the hints see there.
    """
    seen = _seen_channels(evidence, cells)
    return np.concatenate([seen, hint_channels(evidence, seen)]) if hints else seen


def _seen_channels(evidence: EvidenceGrid, cells: int) -> Float32[np.ndarray, "4 {cells} {cells} {cells}"]:
    """CHANNELS: each cell is the mean of 2×2×2 look-ups into the grid."""
    rows = [_nearest(evidence, axis, 2 * cells) for axis in range(3)]
    channels = np.zeros((len(CHANNELS), cells, cells, cells), np.float32)
    channels[3] = 1.0
    if not all((row >= 0).any() for row in rows):
        return channels
    reached = [np.flatnonzero(row >= 0)[[0, -1]] // 2 for row in rows]  # cells that the grid reaches into
    block = tuple(slice(first, last + 1) for first, last in reached)
    rows = [row[2 * first : 2 * last + 2] for row, (first, last) in zip(rows, reached, strict=True)]
    place = np.ix_(*(np.maximum(row, 0) for row in rows))
    known = [(row >= 0).astype(np.uint8) for row in rows]
    inside = known[0][:, None, None] * known[1][:, None] * known[2]
    state = evidence.state[place]
    surface = (state == Evidence.SURFACE) * inside
    band = _BAND * 2.0 / cells
    steps = np.rint(np.clip(evidence.sdf / band, -1, 1) * 1000).astype(np.int16)
    hits = _pooled(surface)
    channels[(0, *block)] = _pooled(steps[place] * surface) / (1000.0 * np.maximum(hits, 1))
    channels[(1, *block)] = hits / 8.0
    channels[(2, *block)] = _pooled((state == Evidence.EMPTY) * inside) / 8.0
    channels[(3, *block)] = 1.0 - _pooled(inside) / 8.0
    return channels


def _nearest(evidence: EvidenceGrid, axis: int, count: int) -> Int64[np.ndarray, "{count}"]:
    """Voxel nearest to each of `count` positions along an axis of the cube; -1 beyond the grid."""
    at = (np.arange(count) + 0.5) * (2.0 / count) - 1.0
    row = np.floor((at - evidence.origin[axis]) / evidence.voxel + 0.5).astype(np.int64)
    return np.where((row >= 0) & (row < evidence.state.shape[axis]), row, -1)


def _pooled(field: UInt8[np.ndarray, "n n n"] | np.ndarray) -> np.ndarray:
    """Sums over blocks of 2×2×2."""
    field = field[::2] + field[1::2]
    field = field[:, ::2] + field[:, 1::2]
    return field[:, :, ::2] + field[:, :, 1::2]
