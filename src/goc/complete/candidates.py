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
Filler = Callable[[Measured, EvidenceGrid], Grid]
"""What asks a network: from what was measured, its signed distance at the voxels of `with_margin` of a grid."""

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
    fill: Grid | None
    """What it is composed from; None for the hull."""
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


def refined(fill: Grid, coarse: EvidenceGrid, fine: EvidenceGrid) -> Float32[np.ndarray, "i j k"]:
    """A fill at the voxels of `with_margin(coarse)`, interpolated at those of `with_margin(fine)`, in their voxels.

    What is imagined is smooth: networks answer in 48 cells, hulls are flat. What was measured is as fine as before,
    since measured distances win where a field is composed.
    """
    steps = round(coarse.voxel / fine.voxel)
    if steps == 1:
        return fill
    margin = (fill.shape[0] - coarse.state.shape[0]) // 2
    for axis, count in enumerate(fine.state.shape):
        at = np.clip((np.arange(count + 2 * margin) - margin) / steps + margin, 0, fill.shape[axis] - 1)
        low = np.floor(at).astype(np.int64)
        share = (at - low).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(3)])
        high = np.minimum(low + 1, fill.shape[axis] - 1)
        fill = fill.take(low, axis) * (1 - share) + fill.take(high, axis) * share
    return fill * np.float32(steps)


def candidates(
    found: Measured, supposed: Hypotheses, network: Filler | None, coarse: Measured | None = None
) -> Iterator[Candidate]:
    """All ways to complete one object that apply to it. The hull always does; where it imagines next to nothing, alone.

    Args:
        found: seen surface and evidence.
        supposed: of the same object.
        network: asked at most twice, about `found`; None: no network.
        coarse: the same object in coarser voxels (`coarsened`), in which candidates are filled and composed; None: as
            fine as it was found. Networks see `found` in any case: in coarse voxels they answer worse (measured: 0039).
    """
    judged = found if coarse is None else coarse
    grid = with_margin(judged.evidence)
    hull = evidence_hull(grid)
    first = _candidate(HULL, judged, grid, None, hull)
    yield first
    if imagined_share(first.composed) < _COMPLETE:
        return
    for name in ALL[1:]:
        fill = _fill_of(name, found, judged, supposed, network)
        if fill is not None:
            yield _candidate(name, judged, grid, fill, hull)


def _fill_of(name: str, found: Measured, judged: Measured, supposed: Hypotheses, network: Filler | None) -> Grid | None:
    """The fill of one candidate, as `compose_field` takes it; None where it does not apply."""
    if name == CONVEX:
        return convex_fill(judged)
    if name == NETWORK:
        return None if network is None else network(found, judged.evidence)
    if name == OUTLINES:
        return outline_fill(judged, supposed.axes)
    if not supposed.planes or (name == MIRRORED_NETWORK and network is None):
        return None
    whole = _with_images(judged, supposed.planes)
    if name == MIRRORED_CONVEX or network is None:
        fill = convex_fill(whole)
    else:
        fill = network(whole if found is judged else _with_images(found, supposed.planes), whole.evidence)
    return compose_field(with_margin(whole.evidence), fill, whole.mesh.vertices).distance


def _with_images(found: Measured, planes: Sequence[MirrorPlane]) -> Measured:
    """What was measured and its images in planes, one after the other."""
    for plane in planes:
        found = mirrored(found, plane)
    return found


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


def _candidate(name: str, found: Measured, grid: EvidenceGrid, fill: Grid | None, hull: Grid) -> Candidate:
    composed = compose_field(grid, fill, found.mesh.vertices, hull)
    if fill is None:
        return Candidate(name=name, fill=None, composed=composed, against=0.0, misfit=0.0)
    near = (grid.state == Evidence.SURFACE) & (np.abs(grid.sdf) < grid.voxel)
    apart = np.abs(np.clip(fill[near], -BAND, BAND) - grid.sdf[near] / grid.voxel)
    misfit = float(apart.mean()) if len(apart) else BAND
    against = refuted_share(fill, grid)
    return Candidate(name=name, fill=fill, composed=composed, against=against, misfit=misfit)
