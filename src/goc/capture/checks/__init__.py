"""Nothing wrong in silence: what contradicts itself is refused before seconds are spent, what is doubtful is told."""

from goc.capture.checks.finding import Finding
from goc.capture.checks.stage import check_capture, findings

__all__ = ["Finding", "check_capture", "findings"]
