"""Capture → Capture with ids: things told apart by geometry alone, no network, no mask."""

from goc.segment.config import SegmentConfig
from goc.segment.stage import segment

__all__ = ["SegmentConfig", "segment"]
