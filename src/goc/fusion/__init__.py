"""The fusion engine: depth views in; distances, votes and evidence out. Native, or PyTorch on another device."""

from goc.fusion.cell_counts import CellCounts, count_cells, object_cells
from goc.fusion.config import FusionConfig
from goc.fusion.depth_views import DepthView, depth_view, depth_views
from goc.fusion.detail import DepthNoise, Detail, PixelSizes
from goc.fusion.device_volume import fuse_views
from goc.fusion.evidence import evidence_block_grid, evidence_grid
from goc.fusion.volume import BLOCK, BlockGrid, FusedSurface, Volume, blocks_near, fused_surface, zero_level

__all__ = [
    "BLOCK",
    "CellCounts",
    "DepthNoise",
    "DepthView",
    "Detail",
    "FusionConfig",
    "BlockGrid",
    "FusedSurface",
    "PixelSizes",
    "Volume",
    "blocks_near",
    "count_cells",
    "depth_view",
    "depth_views",
    "evidence_grid",
    "evidence_block_grid",
    "fuse_views",
    "object_cells",
    "fused_surface",
    "zero_level",
]
