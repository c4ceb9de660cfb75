"""`goc inspect`: what a capture holds, and what is damaged in it."""

from goc.capture.inspect.inspection import Inspection
from goc.capture.inspect.stage import Inspected, inspect_capture

__all__ = ["Inspected", "Inspection", "inspect_capture"]
