"""Stage 4: an object seen in part in, the whole object out (paper §5)."""

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
from goc.complete.weights import SHIPPED, Network, build, load_network, save_network

__all__ = [
    "CHANNELS",
    "SHIPPED",
    "SIZES",
    "Completer",
    "Cube",
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
    "batch_of",
    "build",
    "cell_centres",
    "cube_round",
    "evidence_channels",
    "load_network",
    "partial_of",
    "save_network",
]
