"""All checks of a capture, cheap ones first; what contradicts itself is refused, what is doubtful is told."""

from collections.abc import Iterator

from goc.capture.checks.cameras import camera_findings
from goc.capture.checks.depth import depth_findings
from goc.capture.checks.finding import Finding
from goc.capture.checks.ids import id_findings
from goc.capture.checks.names import cut_short, folder_findings
from goc.capture.checks.photographs import photograph_findings, pose_findings
from goc.capture.checks.sample import take_sample
from goc.capture.config import CaptureConfig
from goc.capture.source import Source
from goc.errors import CaptureError
from goc.events import Listener, Warned
from goc.scene import Capture


def check_capture(source: Source, capture: Capture, config: CaptureConfig, notify: Listener) -> None:
    """Check that the numbers of a capture mean what they say.

    Args:
        source: files and cameras, as they were read.
        capture: assembled from it.
        config: `checks` says what becomes of contradictions.
        notify: hears of doubts, and of contradictions that are to be warnings.

    Raises:
        CaptureError: the first contradiction, with its cause and remedy in one line.
        FileError: a sampled image is damaged, or any ends too early.
    """
    if config.checks == "off":
        return
    for finding in findings(source, capture, config):
        if finding.severity == "contradiction" and config.checks == "refuse":
            raise CaptureError(f"{source.path}: {finding.message}")
        notify(Warned(stage="capture", message=finding.message.rstrip(".")))


def findings(source: Source, capture: Capture, config: CaptureConfig) -> Iterator[Finding]:
    """All that checks find, lazily: what costs nothing comes first."""
    yield from camera_findings(source, capture)
    yield from folder_findings(source, config.use_ids, config.use_depth)
    cut_short(source)
    sample = take_sample(source, capture, config.depth_kind or source.depth_kind)
    yield from depth_findings(sample)
    yield from id_findings(sample)
    yield from photograph_findings(sample)
    yield from pose_findings(sample)
