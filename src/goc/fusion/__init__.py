"""The fusion engine: depth views in; distances, votes and evidence out. Native, or PyTorch on another device."""

from goc.fusion.cells import Cells, count_cells, object_cells
from goc.fusion.config import FusionConfig
from goc.fusion.depth_views import DepthView, depth_view, depth_views
from goc.fusion.device_volume import fused
from goc.fusion.evidence import evidence_grid, evidence_lattice
from goc.fusion.volume import BLOCK, Lattice, Surface, Volume, blocks_near, surface, zero_level

__all__ = [
    "BLOCK",
    "Cells",
    "DepthView",
    "FusionConfig",
    "Lattice",
    "Surface",
    "Volume",
    "blocks_near",
    "count_cells",
    "depth_view",
    "depth_views",
    "evidence_grid",
    "evidence_lattice",
    "fused",
    "object_cells",
    "surface",
    "zero_level",
]
