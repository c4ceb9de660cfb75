"""Capture → Capture with ids: things told apart by geometry alone, no network, no mask."""

from goc.priors.segmentation.config import SegmentConfig
from goc.priors.segmentation.stage import segment

__all__ = ["SegmentConfig", "segment"]
