"""How finely a surface was measured: the size of its pixels and the noise of its depth, which set voxels and bands."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from goc.fusion.config import FusionConfig
from goc.fusion.depth_views import DepthView

_LEAST_BAND = 2.0
"""Voxels: a narrower band has holes."""
_PIXEL_SHARE = 1 / 3
"""Voxels are no smaller than this share of a pixel: what about ten views together resolve."""
_BANDS = 3.0
"""Half the width of the band, in standard deviations of the noise."""


@dataclass(frozen=True, kw_only=True)
class DepthNoise:
    """Standard deviation of depth, floor + square · z²: a fixed part, and that of sensors that triangulate."""

    floor: float
    """Scene units."""
    square: float
    """Per scene unit."""

    def at(self, depth: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
        """Standard deviation at depths z, scene units."""
        return self.floor + self.square * depth.square()


@dataclass(frozen=True, kw_only=True)
class Detail:
    """Of one surface. Scene units."""

    footprint: float
    """Side of a pixel on it, square to the ray; a mean over pixels with the weights of fusion."""
    noise: float | None
    """Standard deviation of its depth in one view; None where it was not measured."""

    def finest(self, config: FusionConfig, units_per_metre: float) -> float:
        """Smallest voxel that shows more surface than noise, of which it is one standard deviation."""
        least = config.finest_voxel * units_per_metre
        return max(least, _PIXEL_SHARE * self.footprint, self.noise or 0.0)

    def band(self, voxel: float, config: FusionConfig) -> float:
        """Half the width of the band that one view speaks for: as narrow as noise and voxel allow."""
        widest = config.truncation_voxels * voxel
        return widest if self.noise is None else min(widest, max(_LEAST_BAND * voxel, _BANDS * self.noise))


@dataclass(eq=False)
class PixelSizes:
    """Sums over the pixels of each id, gathered while views go by. Mutable."""

    _sums: dict[int, np.ndarray] = field(default_factory=dict[int, np.ndarray])

    def watched(self, views: Iterable[DepthView]) -> Iterator[DepthView]:
        """The same views; those without ids count as id 0."""
        for view in views:
            self._add(view)
            yield view

    def detail(self, wanted: int | None, noise: DepthNoise | None) -> Detail:
        """Of the surface of one id that was seen; None: of everything seen. Nothing seen sets no bound."""
        chosen = self._sums.values() if wanted is None else [self._sums[wanted]]
        weight, size, depth = sum(chosen, np.array([1e-12, 0.0, 0.0]))
        sigma = None if noise is None else float(noise.at(torch.tensor(depth / weight)))
        return Detail(footprint=float(size / weight), noise=sigma)

    def _add(self, view: DepthView) -> None:
        seen = ~np.isnan(view.slope) & ~np.isnan(view.depth)
        depth = view.depth[seen].astype(np.float64)
        ids = np.zeros(len(depth), np.int64) if view.ids is None else view.ids[seen].astype(np.int64)
        numbers, place = np.unique(ids, return_inverse=True)
        side = 1.0 / float(view.camera.focal_px.mean())
        per_id = [np.bincount(place, weights) for weights in (depth**-2, side / depth, 1.0 / depth)]
        for row, number in enumerate(numbers.tolist()):
            self._sums[number] = self._sums.get(number, np.zeros(3)) + [sums[row] for sums in per_id]
