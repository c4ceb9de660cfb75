"""What a scan shows, and what copies of it tell of the rest."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from goc.complete.compose import Measured
from goc.complete.config import ScanConfig
from goc.complete.copies import Copy
from goc.complete.halves import find_cut, other_half
from goc.complete.mirrors import mirror_planes, surface_points
from goc.complete.scan_evidence import measured_scan, scan_grid
from goc.complete.scan_pose import PosedScan
from goc.complete.viewpoint import carve_free_space
from goc.scene import Evidence

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Supposed:
    """What is supposed of the part of a thing that its scan lacks."""

    copies: tuple[Copy, ...] = ()
    """Copies of the scan that stand in for it."""
    places: Float64[np.ndarray, "q 3"] | None = None
    """Where it may be, should it lie beyond the scan; None: the scan reaches all round the thing."""
    words: tuple[str, ...] = ()
    """What is thereby taken for granted."""


def seen_of(scan: PosedScan, cells: int, places: Float64[np.ndarray, "q 3"] | None = None) -> Measured:
    """What the scan shows: surface, space that its viewpoints saw past, and space below what it stands on.

    Args:
        scan: upright.
        cells: voxels along its longest side.
        places: the grid has room for them as well; they are no evidence.
    """
    grid = scan_grid(scan.cloud.positions, cells, places)
    found = measured_scan(scan.cloud, grid)
    evidence = found.evidence
    for eye in scan.viewpoints:
        evidence = carve_free_space(evidence, scan.cloud.positions, eye)
    if scan.support is not None:
        unknown = np.argwhere(evidence.state == Evidence.UNKNOWN)
        below = scan.support.distance(evidence.origin + evidence.voxel * unknown) < 0
        state = evidence.state.copy()
        state[tuple(unknown[below].T)] = Evidence.EMPTY
        evidence = replace(evidence, state=state)
    return replace(found, evidence=evidence)


def supposed(scan: PosedScan, config: ScanConfig) -> Supposed:
    """What stands in for what a scan lacks.

    Where nothing is known to be empty, the scan may be half a thing, cut through its middle: the other half is a copy,
    and where none joins it, it is a guess, for which there has to be room. From a viewpoint, a scan's rim is an outline
    and no cut; but the thing may mirror itself, and what rays passed tells where it does not.
    """
    if not scan.viewpoints:
        cut = find_cut(scan.cloud, _UP)
        if cut is None:
            return Supposed()
        half = other_half(scan.cloud, _UP, cut)
        if half is not None:
            return Supposed(copies=(half,), places=half.image(scan.cloud.positions), words=(half.words,))
        words = "half a thing: nothing that was measured joins the rim, so that the other half is a guess"
        return Supposed(places=cut.mirrored(scan.cloud.positions), words=(words,))
    evidence = seen_of(scan, config.cells).evidence
    planes = mirror_planes(*surface_points(evidence), evidence, most=1)
    copies = tuple(
        Copy(
            linear=np.eye(3) - 2 * np.outer(plane.normal, plane.normal),
            shift=2 * plane.offset * plane.normal,
            name="mirror image",
            misfit=1 - plane.score,
            words="it mirrors itself, as far as was seen",
        )
        for plane in planes
    )
    places = [copy.image(scan.cloud.positions) for copy in copies]
    words = tuple(copy.words for copy in copies)
    return Supposed(copies=copies, places=np.concatenate(places) if places else None, words=words)
