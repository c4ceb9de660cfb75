"""Capture → Capture: what photographs, depth and shape say before there are splats."""

from goc.priors.config import PriorsConfig, StereoConfig
from goc.priors.segmentation import SegmentConfig, segment
from goc.priors.stage import add_priors

__all__ = ["PriorsConfig", "SegmentConfig", "StereoConfig", "add_priors", "segment"]
