"""What a reader hands over: files and numbers of every view, nothing decoded."""

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
    """How stored ids are to be understood, beyond 255 or 65535 = unlabelled."""

    background: int = 0
    """Stored value of the room."""
    unknown: int | None = None
    """One more stored value that means unlabelled."""
    values: tuple[int, ...] = ()
    """All values that mean something, others being unlabelled; empty if not known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """One view's files."""

    name: str
    lens: Lens
    world_from_cam: Float64[np.ndarray, "4 4"]
    """Rigid, OpenCV camera axes, scene units."""
    image: Path
    depth: Path | None = None
    ids: Path | None = None
    normals: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """A capture's files."""

    path: Path
    """What errors call the capture."""
    views: tuple[View, ...]
    depth_units_per_metre: float = MILLIMETRES
    """How many steps of a stored depth make a scene unit, which is a metre where depth was measured."""
    depth_kind: DepthKind = "metric"
    id_codes: IdCodes = IdCodes()
    id_names: dict[int, str] = field(default_factory=dict)
    points: PointCloud | None = None


def complain(where: Path | str, culprits: Sequence[str], total: int, what: str, remedy: str) -> CaptureError:
    """Put an error into the house's words: where, how many, the first culprit, what to do."""
    return CaptureError(f"{where}: {count_of(culprits, total)} {what} (first: {shown(culprits[0])}). {remedy}")


def shown(name: str) -> str:
    """A name from a file, fit for one line: printable and not too long."""
    short = name if len(name) <= _LONGEST_NAME else name[:_LONGEST_NAME] + "…"
    return short if short.isprintable() and short else repr(short)


def count_of(culprits: Sequence[object], total: int) -> str:
    """Such as `3 of 120`."""
    return f"{len(culprits)} of {total}"


def parse_id_names(where: Path, stored: dict[str, str]) -> dict[int, str]:
    """Names by id, from a JSON object whose keys are ids.

    Raises:
        CaptureError: a key is not an id.
    """
    bad = [key for key in stored if not (key.isascii() and key.isdigit() and int(key[:6]) <= 32767 and len(key) <= 5)]
    if bad:
        raise complain(
            where, [repr(key[:20]) for key in bad], len(stored), "names belong to no id", "Use ids 0 to 32767."
        )
    return {int(key): name for key, name in stored.items()}
