"""What scans lack or tell beyond depth: halves, planes behind which nothing is, rays that met nothing."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from goc.scene import Evidence, EvidenceGrid
from goc.settings import Settings, Share

Random = np.random.Generator


@dataclass(frozen=True, kw_only=True)
class CutConfig(Settings):
    """Shares of the objects of which less is told than their cameras saw, or more."""

    forget_empty: Share = 0.12
    """Share of objects whose seen-empty space is forgotten, as a bare point cloud has none."""
    bare: Share = 0.08
    """Share whose cameras tell of the object alone, as a scan cut out of its surroundings does."""
    contacts: Share = 0.5
    """Share of objects with a support or walls whose space behind those is known to be empty."""
    halves: Share = 0.08
    """Share of which all beyond a plane is forgotten."""
    wide: Share = 0.2
    """Share in a wider cube than the rule gives, with evidence to the end of a wider box."""


AS_SEEN = CutConfig(forget_empty=0.0, bare=0.0, contacts=0.0, halves=0.0, wide=0.0)
"""All that the cameras saw, and nothing else."""


def with_contact_planes(
    evidence: EvidenceGrid, planes: Float64[np.ndarray, "k 4"], slack: Float64[np.ndarray, "k"]
) -> EvidenceGrid:
    """Unknown space behind planes n·x = d (below the support, behind walls) is empty, as `goc carve` marks it.

    It does so from a voxel behind the plane on.

    Args:
        evidence: world.
        planes: n points to the object's side.
        slack: how far each plane was estimated from where it is, world units.
    """
    state = evidence.state
    for plane, off in zip(planes, slack, strict=True):
        behind = _above(evidence, plane[:3], plane[3] + off) < -evidence.voxel
        state = np.where(behind & (state == Evidence.UNKNOWN), np.uint8(Evidence.EMPTY), state)
    return replace(evidence, state=state)


def cut_in_half(
    evidence: EvidenceGrid, seen: Float64[np.ndarray, "p 3"], random: Random
) -> tuple[EvidenceGrid, Float64[np.ndarray, "4"]]:
    """Forget all beyond a random plane through the middle of what was seen; mostly an upright one.

    Returns:
        The evidence, and the plane n·x = d; n points to what is forgotten.
    """
    normal = random.normal(size=3) * [1, 1, random.choice([0.1, 1.0], p=[0.7, 0.3])]
    normal /= np.linalg.norm(normal)
    offset = float(np.quantile(seen @ normal, random.uniform(0.4, 0.7)))
    beyond = _above(evidence, normal, offset) > 0
    state = np.where(beyond, np.uint8(Evidence.UNKNOWN), evidence.state)
    sdf = np.where(beyond, np.float32(0), evidence.sdf)
    return replace(evidence, state=state, sdf=sdf), np.append(normal, offset)


def without_empty(evidence: EvidenceGrid) -> EvidenceGrid:
    """The evidence with its seen-empty space forgotten, as a bare point cloud has none."""
    state = np.where(evidence.state == Evidence.EMPTY, np.uint8(Evidence.UNKNOWN), evidence.state)
    return replace(evidence, state=state)


def _above(evidence: EvidenceGrid, normal: Float64[np.ndarray, "3"], offset: float) -> Float64[np.ndarray, "x y z"]:
    """Distance of each voxel's centre above a plane."""
    x, y, z = (
        normal[axis] * (evidence.origin[axis] + evidence.voxel * np.arange(count))
        for axis, count in enumerate(evidence.state.shape)
    )
    return x[:, None, None] + y[:, None] + z - offset
