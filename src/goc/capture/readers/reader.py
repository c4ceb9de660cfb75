"""What a format brings."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from goc.capture.config import CaptureConfig
from goc.capture.source import Source
from goc.events import Listener


@dataclass(frozen=True, kw_only=True)
class Reader:
    """How captures of one format are recognised and read."""

    name: str
    """What users call the format."""
    expects: str
    """The files it is recognised by, as errors tell them."""
    detect: Callable[[Path], bool]
    """Whether a path holds such a capture, by what is there; opens nothing large."""
    read: Callable[[Path, CaptureConfig, Listener], Source]
    """The files and numbers of every view; images stay closed."""
