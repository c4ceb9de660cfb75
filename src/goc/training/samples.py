"""Training batches: masked objects, and query points with their true signed distance."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from goc.complete import PartialBatch, evidence_channels
from goc.settings import Count, Range, Settings, Share
from goc.training.masking import MaskConfig, MaskedObject, mask
from goc.training.watertight_shape import WatertightShape

Random = np.random.Generator
Draw = Callable[[Random], WatertightShape]
"""Draws a shape; the same generator state gives the same shape."""

_NEAR = (0.01, 0.05)
"""Standard deviations of the queries round the true surface, model units."""
_KNOWN_EMPTY = 0.15
"""Share of uniform queries kept in cells that rays passed: space known to be empty needs few."""


@dataclass(frozen=True, kw_only=True)
class LoaderConfig(Settings):
    """What a batch is made of."""

    batch: Count = 8
    """Objects a step and process."""
    masks: Count = 2
    """Masks of each shape: to make a shape takes longer than to mask it."""
    reuse: Annotated[int, Range(least=1, most=8)] = 4
    """Batches that each mask takes part in, every time in another of the eight poses that gravity leaves: a mask
    costs several steps."""
    queries: Count = 4096
    """Query points of each object in each batch."""
    near: Share = 0.5
    """Share of queries near the true surface; the others are uniform, mostly where the evidence decides nothing."""
    prepared_share: Share = 0.4
    """Share of prepared meshes, where there are any; the others are procedural."""
    resolution: Annotated[int, Range(least=8, most=1024)] = 96
    """Voxels along the longest side of a procedural shape."""
    workers: Annotated[int, Range(least=0, most=1024)] = 1
    """Processes that make batches; 0 makes them between steps."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingBatch:
    """b objects, seen in part, with the truth at q points each."""

    seen: PartialBatch
    queries: Float[Tensor, "b q 3"]
    distance: Float[Tensor, "b q"]
    """Signed, model units, negative inside; the sign is exact, the size near the surface only."""

    def to(self, device: torch.device | str) -> "TrainingBatch":
        """The same on another device."""
        return TrainingBatch(
            seen=self.seen.to(device), queries=self.queries.to(device), distance=self.distance.to(device)
        )


def make_batch(
    draw: Draw, loader: LoaderConfig, masking: MaskConfig, cells: int, seed: Sequence[int], hints: bool = False
) -> TrainingBatch:
    """One batch; the same for the same seed, wherever it is made."""
    random = np.random.default_rng(list(seed))
    masked: list[MaskedObject] = []
    while len(masked) < loader.batch:
        solid = draw(random)
        looks = (mask(solid, masking, random) for _ in range(min(loader.masks, loader.batch - len(masked))))
        masked += [look for look in looks if look is not None]
    channels = [evidence_channels(one.partial.evidence, cells, hints) for one in masked]
    pairs = zip(masked, channels, strict=True)
    asked = [draw_queries(one, channel, loader, random) for one, channel in pairs]
    return TrainingBatch(
        seen=PartialBatch(
            points=torch.from_numpy(np.stack([one.partial.points for one in masked])),
            normals=torch.from_numpy(np.stack([one.partial.normals for one in masked])),
            evidence=torch.from_numpy(np.stack(channels)),
        ),
        queries=torch.from_numpy(np.stack([queries for queries, _ in asked])),
        distance=torch.from_numpy(np.stack([distance for _, distance in asked])),
    )


def draw_queries(
    masked: MaskedObject, channels: Float32[np.ndarray, "c n n n"], loader: LoaderConfig, random: Random
) -> tuple[Float32[np.ndarray, "q 3"], Float32[np.ndarray, "q"]]:
    """Points in the cube with their true signed distance: near the surface, and wherever rays did not decide."""
    near = int(loader.near * loader.queries)
    surface, _ = masked.placed.surface(near, int(random.integers(2**31)))
    sigma = np.where(np.arange(near) % 2, *_NEAR)[:, None]
    close = masked.cube.model_from_world(surface) + random.normal(0, 1, (near, 3)) * sigma
    close = close[(np.abs(close) <= 1).all(-1)]
    far = _undecided(channels, loader.queries - len(close), random)
    queries = random.permutation(np.concatenate([close, far])).astype(np.float32)  # any part of them is like the whole
    return queries, true_distance(masked, queries)


def true_distance(masked: MaskedObject, queries: Float32[np.ndarray, "q 3"]) -> Float32[np.ndarray, "q"]:
    """Signed distance of the whole object at points in its cube, model units."""
    world = masked.cube.world_from_model(queries)
    return masked.placed.distances(world.astype(np.float64)) * np.float32(2.0 / masked.cube.side)


def _undecided(channels: Float32[np.ndarray, "c n n n"], count: int, random: Random) -> Float32[np.ndarray, "q 3"]:
    cells = channels.shape[-1]
    found, missing = [], count
    while missing > 0:
        points = random.uniform(-1, 1, (2 * missing, 3)).astype(np.float32)
        index = np.minimum(((points + 1) * (cells / 2)).astype(np.int64), cells - 1)
        empty = channels[2, index[:, 0], index[:, 1], index[:, 2]]
        kept = points[random.random(len(points)) > empty * (1 - _KNOWN_EMPTY)][:missing]
        found.append(kept)
        missing -= len(kept)
    return np.concatenate(found) if found else np.zeros((0, 3), np.float32)
