"""Candidates for what nobody saw of an object: each a fill, tested against what rays passed and what was measured."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64

from goc.complete.compose import Composition, Measured, compose_field, with_margin
from goc.complete.convex import convex_fill, refuted_share
from goc.complete.hull import BAND, evidence_hull
from goc.complete.mirrored import mirrored
from goc.complete.mirrors import MirrorPlane, mirror_planes, surface_points
from goc.complete.outlines import outline_fill, square_axes
from goc.scene import Evidence, EvidenceGrid

Grid = Float32[np.ndarray, "x y z"]
Filler = Callable[[Measured], Grid]
"""What asks a network: from what was measured, its signed distance at the voxels of `with_margin`."""

HULL, CONVEX, NETWORK = "evidence hull", "convex hull", "network"
MIRRORED_CONVEX, MIRRORED_NETWORK = "mirrored convex hull", "mirrored network"
OUTLINES = "outlines"
ALL = (HULL, CONVEX, NETWORK, MIRRORED_CONVEX, MIRRORED_NETWORK, OUTLINES)

_CELLS = 56
"""Voxels along the longest side that are enough to judge a candidate by."""
_COMPLETE = 0.005
"""Share of the hull's surface that was not measured below which there is nothing to choose."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One way to complete an object, composed with what was measured, and how far the measurement refutes it."""

    name: str
    composed: Composition
    against: float
    """Share of the proposal's solid, next to what was measured, in space that rays passed. [0, 1]"""
    misfit: float
    """Mean distance between the proposal and the measured surface, where it was seen, voxels. [0, BAND]"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypotheses:
    """What an object seems to be, read off what was measured of it."""

    planes: tuple[MirrorPlane, ...]
    """In which it mirrors itself."""
    axes: Float64[np.ndarray, "3 3"]
    """Rows: perpendicular directions that its normals follow."""


def hypotheses(found: Measured) -> Hypotheses:
    """Mirror planes and axes of what was measured."""
    return Hypotheses(
        planes=mirror_planes(*surface_points(found.evidence), found.evidence),
        axes=square_axes(found),
    )


def coarsened(found: Measured) -> Measured:
    """The same with every second, third … voxel alone, so that no side has much more than `_CELLS`: quick to judge."""
    evidence = found.evidence
    step = max(1, round(max(evidence.state.shape) / _CELLS))
    part = (slice(None, None, step),) * 3
    return replace(
        found,
        evidence=replace(
            evidence,
            voxel=step * evidence.voxel,
            state=np.ascontiguousarray(evidence.state[part]),
            sdf=np.ascontiguousarray(evidence.sdf[part]),
        ),
    )


def candidates(found: Measured, supposed: Hypotheses, network: Filler | None) -> Iterator[Candidate]:
    """All ways to complete one object that apply to it. The hull always does; where it imagines next to nothing, alone.

    Args:
        found: seen surface and evidence.
        supposed: of the same object.
        network: asked at most twice; None: no network.
    """
    grid = with_margin(found.evidence)
    hull = evidence_hull(grid)
    first = _candidate(HULL, found, grid, None, hull)
    yield first
    if imagined_share(first.composed) < _COMPLETE:
        return
    for name in ALL[1:]:
        fill = fill_of(name, found, supposed, network)
        if fill is not None:
            yield _candidate(name, found, grid, fill, hull)


def fill_of(name: str, found: Measured, supposed: Hypotheses, network: Filler | None) -> Grid | None:
    """The fill of one candidate, as `compose_field` takes it; None for the hull, and where it does not apply."""
    if name == CONVEX:
        return convex_fill(found)
    if name == NETWORK:
        return None if network is None else network(found)
    if name == MIRRORED_CONVEX:
        return _mirrored_fill(found, supposed.planes, convex_fill)
    if name == MIRRORED_NETWORK:
        return None if network is None else _mirrored_fill(found, supposed.planes, network)
    if name == OUTLINES:
        return outline_fill(found, supposed.axes)
    return None


def imagined_share(composed: Composition) -> float:
    """Share of a composed surface that lies where nothing was known, 0 to 1."""
    solid, unknown = composed.distance < 0, composed.evidence.state == Evidence.UNKNOWN
    pairs = list(zip(neighbours(solid), neighbours(unknown), strict=True))
    area = sum(int((a ^ b).sum()) for (a, b), _ in pairs)
    return sum(int(((a ^ b) & (c | d)).sum()) for (a, b), (c, d) in pairs) / max(area, 1)


def neighbours(field: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """All pairs of voxels that share a face, axis by axis: the further ones and the nearer ones."""
    lines = [np.moveaxis(field, axis, 0) for axis in range(3)]
    return [(line[1:], line[:-1]) for line in lines]


def _mirrored_fill(found: Measured, planes: Sequence[MirrorPlane], filler: Filler) -> Grid | None:
    """The signed distance of what a filler makes of what was measured and its images."""
    if not planes:
        return None
    whole = found
    for plane in planes:
        whole = mirrored(whole, plane)
    return compose_field(with_margin(whole.evidence), filler(whole), whole.mesh.vertices).distance


def _candidate(name: str, found: Measured, grid: EvidenceGrid, fill: Grid | None, hull: Grid) -> Candidate:
    composed = compose_field(grid, fill, found.mesh.vertices, hull)
    if fill is None:
        return Candidate(name=name, composed=composed, against=0.0, misfit=0.0)
    near = (grid.state == Evidence.SURFACE) & (np.abs(grid.sdf) < grid.voxel)
    apart = np.abs(np.clip(fill[near], -BAND, BAND) - grid.sdf[near] / grid.voxel)
    misfit = float(apart.mean()) if len(apart) else BAND
    return Candidate(name=name, composed=composed, against=refuted_share(fill, grid), misfit=misfit)
