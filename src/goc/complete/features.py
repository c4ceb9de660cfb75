"""What can be told of each candidate without the truth: how far the others are from it, and what speaks against it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64

from goc.complete.candidates import CONVEX, HULL, NETWORK, Candidate, imagined_share, neighbours
from goc.complete.compose import Measured
from goc.scene import Evidence

FEATURES = (
    "one",
    "apart from the hull",
    "apart from the convex hull",
    "apart from the network",
    "imagined",
    "against",
    "misfit",
    "voxel",
    "unknown",
)
"""Names of the columns of `features`. Distances are logarithms of shares of the object's longest side."""
_LEAST = 1e-4
"""Distances below this share of the longest side are alike."""
_REFERENCES = (HULL, CONVEX, NETWORK)


def features(found: Measured, options: Sequence[Candidate]) -> Float64[np.ndarray, "m f"]:
    """One row of FEATURES for each candidate of one object."""
    grid, longest = options[0].composed.evidence, longest_side(found)
    unknown = grid.state == Evidence.UNKNOWN
    inside = np.stack([option.composed.distance[unknown] < 0 for option in options])
    areas = np.array([_area(option.composed.distance < 0) for option in options])
    apart = np.array([[float((a ^ b).sum()) for b in inside] for a in inside]) / (areas + areas[:, None]) * 2
    apart = np.log(apart * grid.voxel / longest + _LEAST)
    none = np.full(len(options), np.log(_LEAST))
    names = [option.name for option in options]
    to = [apart[:, names.index(name)] if name in names else none for name in _REFERENCES]
    free = float(inside[0].sum()) * (grid.voxel / longest) ** 3
    columns = [
        np.ones(len(options)),
        *to,
        np.log(np.array([imagined_share(option.composed) for option in options]) + 0.02),
        np.log(np.array([option.against for option in options]) + 0.02),
        np.log(np.array([option.misfit for option in options]) + 0.1),
        np.full(len(options), np.log(grid.voxel / longest)),
        np.full(len(options), np.log(free + 1e-3)),
    ]
    return np.stack(columns, axis=1)


def longest_side(found: Measured) -> float:
    """Longest side of the box of what was measured."""
    return float(np.ptp(found.mesh.vertices, axis=0).max())


def _area(solid: Bool[np.ndarray, "x y z"]) -> float:
    """Area of a solid's surface in voxels' faces, two thirds of those that separate inside and outside."""
    return max(sum(float((a ^ b).sum()) for a, b in neighbours(solid)) * 2 / 3, 1.0)
