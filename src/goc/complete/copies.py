"""A scan and its moved or mirrored copies."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from goc.scene import Evidence, EvidenceGrid, PointCloud


@dataclass(frozen=True, kw_only=True, eq=False)
class Copy:
    """A rigid motion or mirroring that takes a thing, as it seems, to itself: x → linear x + shift."""

    linear: Float64[np.ndarray, "3 3"]
    shift: Float64[np.ndarray, "3"]
    name: str
    """`mirror image` or `half turn`."""
    misfit: float
    """How little speaks for it, 0 to 1."""
    words: str
    """What is thereby taken for granted."""

    def image(self, points: Float[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p 3"]:
        """Where points come to lie."""
        return points @ self.linear.T + self.shift


def with_copy(cloud: PointCloud, copy: Copy, kept: Bool[np.ndarray, "p"] | None = None) -> PointCloud:
    """The points and the copies of those that are kept; None: all. Normals stay outwards."""
    assert cloud.normals is not None
    kept = np.ones(len(cloud.positions), bool) if kept is None else kept
    moved = copy.image(cloud.positions[kept]).astype(np.float32)
    turned = (cloud.normals[kept] @ copy.linear.T).astype(np.float32)
    return PointCloud(
        positions=np.concatenate([cloud.positions, moved]),
        colours=np.concatenate([cloud.colours, cloud.colours[kept]]),
        normals=np.concatenate([cloud.normals, turned]),
    )


def new_places(cloud: PointCloud, copy: Copy, grid: EvidenceGrid) -> Bool[np.ndarray, "p"]:
    """Points whose copies lie where nothing is known."""
    at = np.rint((copy.image(cloud.positions) - grid.origin) / grid.voxel).astype(int)
    top = np.array(grid.state.shape) - 1
    within = ((at >= 0) & (at <= top)).all(axis=1)
    return within & (grid.state[tuple(np.clip(at, 0, top).T)] == Evidence.UNKNOWN)
