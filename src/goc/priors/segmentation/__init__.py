"""Capture → Capture with ids: instance segmentation by geometry alone, without a network or masks."""

from goc.priors.segmentation.config import SegmentConfig
from goc.priors.segmentation.stage import segment

__all__ = ["SegmentConfig", "segment"]
