"""Settings of the geometric segmentation."""

from dataclasses import dataclass
from typing import Annotated

from goc.settings import Amount, Count, Positive, Range, Seed, Settings


@dataclass(frozen=True, kw_only=True)
class SegmentConfig(Settings):
    """Find the things in a room from depth alone. The defaults need no change from capture to capture."""

    seed: Seed = 0
    """Of the plane search; the same seed gives the same ids."""
    voxel_m: Positive | None = None
    """Edge of the voxels in which depth is fused, metres; default: from the depth's own resolution."""
    max_voxels: Annotated[int, Range(least=1000)] = 1_000_000
    """Voxels grow until a capture fits in this many: what bounds memory and time."""
    max_views: Count = 240
    """Fuse at most this many views, evenly spread; all views get ids."""
    min_object_m: Amount = 0.05
    """Drop things whose longest side is shorter, metres."""
    min_support_m2: Amount = 0.12
    """Horizontal faces from this area on, square metres, may carry other things: tables, counters, shelves."""
