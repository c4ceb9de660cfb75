"""Stage 1, folder → Capture: one reader a format, picked by content."""

from goc.capture.config import CaptureConfig
from goc.capture.load import load_capture

__all__ = ["CaptureConfig", "load_capture"]
