"""What a format brings."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from goc.synth.export.room import RoomCapture

Part = Literal["depth", "ids", "names", "metres"]


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """How a synthetic room is written in one format."""

    name: str
    """As the command line spells it: lower case, words joined by hyphens."""
    writes: str
    """What is written, in a few words; what the format cannot hold is said there."""
    write: Callable[[RoomCapture, Path], None]
    """Write the room into a new folder. Formats that are one file (.r3d, .sens) put it there."""
    lacks: frozenset[Part] = frozenset()
    """What the format cannot hold."""
    resampled: bool = False
    """Photographed by another lens: what is read back is not the same pixel by pixel."""
