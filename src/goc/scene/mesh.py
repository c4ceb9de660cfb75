"""Triangle meshes, and what was measured of an object's surroundings."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """An indexed triangle mesh, counter-clockwise seen from outside, metres."""

    vertices: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "t 3"]
    colours: UInt8[np.ndarray, "v 3"] | None = None
    """sRGB a vertex."""


class Evidence(IntEnum):
    """What the cameras say of a voxel."""

    UNKNOWN = 0
    """No ray reached it."""
    EMPTY = 1
    """Some ray passed through it, or rays ended in it on something else."""
    SURFACE = 2
    """It lies in the truncation band of a measured surface of this object."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvidenceGrid:
    """What was measured in a box round one object: the frame in which completion works."""

    origin: Float64[np.ndarray, "3"]
    """World position of the centre of voxel (0, 0, 0)."""
    voxel: float
    """Edge, metres."""
    state: UInt8[np.ndarray, "x y z"]
    """Values of Evidence."""
    sdf: Float32[np.ndarray, "x y z"]
    """Truncated signed distance, metres, positive outside; valid where state is SURFACE."""
