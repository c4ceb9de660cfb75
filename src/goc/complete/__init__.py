"""Stage 4: an object seen in part in, the whole object out (paper §5)."""

from goc.complete.compose import compose, compose_field, with_margin
from goc.complete.config import CompleteConfig, ScanConfig
from goc.complete.decode import Lattice, Refinement, decode, signed_distance
from goc.complete.hull import evidence_hull
from goc.complete.lite import LiteConfig, LiteField, OscLite
from goc.complete.osc import SIZES, Osc, OscConfig, OscField
from goc.complete.partial import (
    CHANNELS,
    Completer,
    Cube,
    OccupancyField,
    Partial,
    PartialBatch,
    batch_of,
    cell_centres,
    cube_round,
    evidence_channels,
    partial_of,
)
from goc.complete.scan import complete_scan
from goc.complete.stage import check_completion, complete_objects, model_fill
from goc.complete.weights import SHIPPED, Network, build, load_network, save_network

__all__ = [
    "CHANNELS",
    "SHIPPED",
    "SIZES",
    "CompleteConfig",
    "Completer",
    "Cube",
    "Lattice",
    "LiteConfig",
    "LiteField",
    "Network",
    "OccupancyField",
    "Osc",
    "OscConfig",
    "OscField",
    "OscLite",
    "Partial",
    "PartialBatch",
    "Refinement",
    "ScanConfig",
    "batch_of",
    "build",
    "cell_centres",
    "check_completion",
    "complete_objects",
    "complete_scan",
    "compose",
    "compose_field",
    "cube_round",
    "decode",
    "evidence_channels",
    "evidence_hull",
    "load_network",
    "model_fill",
    "partial_of",
    "save_network",
    "signed_distance",
    "with_margin",
]
