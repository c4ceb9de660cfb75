"""Capture → Capture: what photographs, depth and shape say before there are splats."""

from goc.priors.config import PriorsConfig, StereoConfig
from goc.priors.consensus import IdsMode, Repair, repair_ids
from goc.priors.segmentation import SegmentConfig, segment
from goc.priors.stage import add_priors

__all__ = [
    "IdsMode",
    "PriorsConfig",
    "Repair",
    "SegmentConfig",
    "StereoConfig",
    "add_priors",
    "repair_ids",
    "segment",
]
