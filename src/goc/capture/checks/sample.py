"""Views that stand for all others in checks that need pixels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from goc.capture.source import Source, StoredDepthKind
from goc.scene import Capture, Frame

_MOST, _FEWEST = 16, 6
_PIXELS = 60_000_000
"""Stored pixels that are decoded, about: two or three seconds of photographs of 12 megapixels."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """Some decoded views of a capture, spread evenly over it."""

    source: Source
    capture: Capture
    indices: tuple[int, ...]
    frames: tuple[Frame, ...]
    kind: StoredDepthKind
    """How stored depth was read."""

    @property
    def poses(self) -> Float64[np.ndarray, "n 4 4"]:
        """World from camera of all views, not only of the decoded ones."""
        return all_poses(self.capture)


def take_sample(source: Source, capture: Capture, kind: StoredDepthKind) -> Sample:
    """Decode 6 to 16 views, fewer the larger their files are; the capture's cache keeps them for later stages.

    Raises:
        FileError: an image is damaged.
    """
    pixels = np.mean([view.lens.width * view.lens.height for view in source.views])
    number = int(np.clip(_PIXELS / max(float(pixels), 1.0), _FEWEST, _MOST))
    rows = np.unique(np.linspace(0, len(capture) - 1, min(number, len(capture))).round().astype(int))
    indices = tuple(rows.tolist())
    frames = tuple(capture[row] for row in indices)
    return Sample(source=source, capture=capture, indices=indices, frames=frames, kind=kind)


def all_poses(capture: Capture) -> Float64[np.ndarray, "n 4 4"]:
    """World from camera of all views."""
    return np.stack([camera.world_from_cam.double().numpy() for camera in capture.cameras])
