"""What a scan shows, and what copies of it tell of the rest."""

from dataclasses import replace

import numpy as np

from goc.complete.compose import Measured
from goc.complete.config import ScanConfig
from goc.complete.copies import Copy
from goc.complete.halves import other_half
from goc.complete.mirrors import mirror_planes, surface_points
from goc.complete.scan_evidence import measured_scan, scan_grid
from goc.complete.scan_pose import PosedScan
from goc.complete.viewpoint import carve_free_space
from goc.scene import Evidence

_UP = np.array([0.0, 0.0, 1.0])


def seen_of(scan: PosedScan, cells: int, copies: tuple[Copy, ...] = ()) -> Measured:
    """What the scan shows: surface, space that its viewpoints saw past, and space below what it stands on.

    Args:
        scan: upright.
        cells: voxels along its longest side.
        copies: the grid has room for them; they are no evidence.
    """
    others = [copy.image(scan.cloud.positions) for copy in copies]
    grid = scan_grid(scan.cloud.positions, cells, np.concatenate(others) if others else None)
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


def scan_copies(scan: PosedScan, config: ScanConfig) -> tuple[Copy, ...]:
    """Copies of the scan that stand in for what it lacks.

    Where nothing is known to be empty, the scan may be half a thing, cut through its middle. From a viewpoint, its rim
    is an outline and no cut; but it may mirror itself, and what rays passed tells where it does not.
    """
    if not scan.viewpoints:
        half = other_half(scan.cloud, _UP)
        return () if half is None else (half,)
    evidence = seen_of(scan, config.cells).evidence
    planes = mirror_planes(*surface_points(evidence), evidence, most=1)
    return tuple(
        Copy(
            linear=np.eye(3) - 2 * np.outer(plane.normal, plane.normal),
            shift=2 * plane.offset * plane.normal,
            name="mirror image",
            misfit=1 - plane.score,
            words="it mirrors itself, as far as was seen",
        )
        for plane in planes
    )
