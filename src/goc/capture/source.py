"""Result of a capture reader: files and cameras of every view, before any image is decoded."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from goc.errors import CaptureError
from goc.files import MILLIMETRES
from goc.scene import DepthKind, PointCloud

_LONGEST_NAME = 120


@dataclass(frozen=True)
class Lens:
    """Intrinsics of the stored pixels; pixel (0, 0) is centred at (0.5, 0.5).

    Distortion is OpenCV's: radial 1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸ and tangential p1, p2.
    """

    width: int
    height: int
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    radial: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    tangential: tuple[float, float] = (0.0, 0.0)

    @property
    def is_pinhole(self) -> bool:
        """Whether straight lines stay straight."""
        return not any(self.radial) and not any(self.tangential)


@dataclass(frozen=True)
class IdCodes:
    """Meaning of stored ids, besides 255 and 65535, which mean unlabelled."""

    background: int = 0
    """Stored value of the room."""
    unknown: int | None = None
    """Another stored value that means unlabelled."""
    values: tuple[int, ...] = ()
    """All valid stored values; others are unlabelled. Empty if they are not known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """Camera and files of one view."""

    name: str
    lens: Lens
    world_from_cam: Float64[np.ndarray, "4 4"]
    """Rigid pose, OpenCV camera axes, scene units."""
    image: Path
    depth: Path | None = None
    ids: Path | None = None
    normals: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """Views and files of a capture."""

    path: Path
    """Path of the capture, as errors name it."""
    views: tuple[View, ...]
    depth_units_per_metre: float = MILLIMETRES
    """Steps of a stored depth in a scene unit, which is a metre where depth was measured."""
    depth_kind: DepthKind = "metric"
    id_codes: IdCodes = IdCodes()
    id_names: dict[int, str] = field(default_factory=dict)
    points: PointCloud | None = None


def complain(where: Path | str, culprits: Sequence[str], total: int, what: str, remedy: str) -> CaptureError:
    """Make an error in one line: where, how many, the first culprit, what to do."""
    return CaptureError(f"{where}: {count_of(culprits, total)} {what} (first: {shown(culprits[0])}). {remedy}")


def shown(name: str) -> str:
    """Make a name from a file printable and at most 120 characters long, for messages of one line."""
    short = name if len(name) <= _LONGEST_NAME else name[:_LONGEST_NAME] + "…"
    return short if short.isprintable() and short else repr(short)


def count_of(culprits: Sequence[object], total: int) -> str:
    """Number of culprits in words, for example `3 of 120`."""
    return f"{len(culprits)} of {total}"


def parse_id_names(where: Path, stored: dict[str, str]) -> dict[int, str]:
    """Convert a JSON object whose keys are ids to names by id.

    Raises:
        CaptureError: a key is not an id.
    """
    bad = [key for key in stored if not (key.isascii() and key.isdigit() and int(key[:6]) <= 32767 and len(key) <= 5)]
    if bad:
        raise complain(
            where, [repr(key[:20]) for key in bad], len(stored), "names belong to no id", "Use ids 0 to 32767."
        )
    return {int(key): name for key, name in stored.items()}
