"""Capture → Capture: what photographs, depth and shape say before there are splats."""

from goc.priors.segmentation import SegmentConfig, segment

__all__ = ["SegmentConfig", "segment"]
