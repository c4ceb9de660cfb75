"""Result of a capture reader: files and cameras of every view, before any image is decoded."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float64, UInt8

from goc.capture.lens import Lens, Projection, equirectangular
from goc.capture.pixels import Pixels, Stored
from goc.capture.scan import Scan
from goc.errors import CaptureError
from goc.files import MILLIMETRES
from goc.scene import UNLABELLED, PointCloud

__all__ = [
    "CameraAxes",
    "FarPoints",
    "IdCodes",
    "Lens",
    "Pixels",
    "PoseDirection",
    "Projection",
    "Scan",
    "Source",
    "Stored",
    "StoredDepthKind",
    "View",
    "complain",
    "count_of",
    "equirectangular",
    "parse_id_names",
    "shown",
]

StoredDepthKind = Literal["metric", "distance", "affine", "inverse"]
"""Meaning of stored depth: `DepthKind`, or the distance to the camera's centre along each pixel's ray."""
_LONGEST_NAME = 120

PoseDirection = Literal["camera-to-world", "world-to-camera"]
CameraAxes = Literal["opencv", "opengl", "ros"]
"""opencv: x right, y down, z forward. opengl, also of Blender and ARKit: x right, y up, z back. ros, of robots' bodies:
x forward, y left, z up."""


@dataclass(frozen=True)
class IdCodes:
    """Meaning of stored ids, besides 255 and 65535, which mean unlabelled unless something here says otherwise."""

    background: int = 0
    """Stored value of the room."""
    unknown: int | None = None
    """Another stored value that means unlabelled."""
    values: tuple[int, ...] = ()
    """All valid stored values; others are unlabelled. Empty if they are not known."""
    table: tuple[tuple[int, int], ...] = ()
    """Pairs of a stored value (of a colour: r << 16 | g << 8 | b) and its id, 0 for the room, UNLABELLED for none. It
    replaces all of the above."""
    others: int = UNLABELLED
    """Id of stored values that the table does not hold."""
    blurred: bool = False
    """Images were scaled with smoothing: values at edges are mixtures, and count for nothing."""
    room: tuple[int, ...] = ()
    """Stored values of walls, floor and ceiling that are instances of their own; `background` is then unlabelled."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """Camera and files of one view. Depth, ids, normals, confidence and mask are registered to the image."""

    name: str
    lens: Lens
    world_from_cam: Float64[np.ndarray, "4 4"]
    """Rigid pose, OpenCV camera axes, scene units."""
    image: Pixels
    depth: Pixels | None = None
    ids: Pixels | None = None
    normals: Pixels | None = None
    depth_lens: Lens | None = None
    """Of depth that has intrinsics of its own; None where depth shares the image's field of view, at any resolution."""
    depth_units_per_metre: float | None = None
    """Steps of this view's depth in a scene unit, where it differs from the source's."""
    confidence: Pixels | None = None
    """How sure the sensor is of each depth; see `Source.least_confidence`."""
    mask: Pixels | None = None
    """0 where the photograph shows nothing that belongs to the scene: no colour, depth or id counts there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FarPoints:
    """Coloured points before the world's offset is taken off: float32 would lose their digits."""

    positions: Float64[np.ndarray, "p 3"]
    colours: UInt8[np.ndarray, "p 3"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """Views and files of a capture."""

    path: Path
    """Path of the capture, as errors name it."""
    views: tuple[View, ...]
    depth_units_per_metre: float = MILLIMETRES
    """Steps of a stored depth in a scene unit, which is a metre where depth was measured."""
    depth_kind: StoredDepthKind = "metric"
    least_confidence: float = 0.0
    """Depth whose confidence is below counts as none."""
    id_codes: IdCodes = IdCodes()
    id_names: dict[int, str] = field(default_factory=dict)
    points: PointCloud | FarPoints | None = None
    metric: bool | None = None
    """Whether the poses are known to be in metres. None: where there is metric depth."""
    scan: Scan | None = None
    """Surface that a scanner measured, in the world of the poses: views see their ids on it, and their depth where they
    have none."""
    up: tuple[float, float, float] | None = None
    """Which way is up in the world, to a few degrees, where the format says it."""
    direction: PoseDirection = "camera-to-world"
    """What the poses in the files map from and to; those of `views` are world from camera."""
    axes: CameraAxes = "opencv"
    """Camera axes of the poses in the files; those of `views` are OpenCV's."""


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
