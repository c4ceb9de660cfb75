"""Stage 4: an object seen in part in, the whole object out (paper §5)."""

from goc.complete.compose import Measured, closed_surface, compose, compose_field, with_margin
from goc.complete.config import CompleteConfig, ScanConfig
from goc.complete.contacts import with_contacts
from goc.complete.decode import QueryGrid, Refinement, decode, signed_distance
from goc.complete.hints import HINTS
from goc.complete.hull import evidence_hull
from goc.complete.lite import LiteConfig, LiteField, OscLite
from goc.complete.osc import SIZES, Osc, OscConfig, OscField
from goc.complete.partial import (
    CHANNELS,
    SIDE,
    Completer,
    Cube,
    OccupancyField,
    PartialBatch,
    PartialObject,
    batch_of,
    bounding_cube,
    cell_centres,
    evidence_channels,
    partial_object,
)
from goc.complete.scan import ClosedScan, complete_scan
from goc.complete.stage import check_completion, close_objects, complete_objects, model_fill
from goc.complete.weights import SHIPPED, Network, begin_from, build, load_network, save_network

__all__ = [
    "CHANNELS",
    "HINTS",
    "ClosedScan",
    "SHIPPED",
    "SIDE",
    "SIZES",
    "CompleteConfig",
    "Completer",
    "Cube",
    "QueryGrid",
    "LiteConfig",
    "LiteField",
    "Measured",
    "Network",
    "OccupancyField",
    "Osc",
    "OscConfig",
    "OscField",
    "OscLite",
    "PartialObject",
    "PartialBatch",
    "Refinement",
    "ScanConfig",
    "batch_of",
    "begin_from",
    "build",
    "cell_centres",
    "check_completion",
    "close_objects",
    "closed_surface",
    "complete_objects",
    "complete_scan",
    "compose",
    "compose_field",
    "bounding_cube",
    "decode",
    "evidence_channels",
    "evidence_hull",
    "load_network",
    "model_fill",
    "partial_object",
    "save_network",
    "signed_distance",
    "with_contacts",
    "with_margin",
]
