"""Completes one partial scan, which has no evidence but its points, and where they were seen from."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64
from scipy.spatial import cKDTree

from goc.complete.compose import compose
from goc.complete.config import ScanConfig
from goc.complete.scan_copies import Supposed, seen_of, supposed
from goc.complete.scan_fill import ScanFill, scan_fill
from goc.complete.scan_points import cleaned
from goc.complete.scan_pose import PosedScan, posed
from goc.errors import CompleteError
from goc.events import Listener, Warned, ignore
from goc.geometry.surfaces import face_areas
from goc.geometry.topology import watertight_flaw
from goc.scene import FlaggedMesh, Mesh, PointCloud

_LEAST_OBSERVED = 0.005
"""Least share of the closed surface that lies on the scan: below, normals look inwards and a shell was closed."""
_LITTLE_OBSERVED = 0.1
"""Share of the closed surface that lies on the scan below which a warning says that the rest is imagined."""
_MUCH_IMAGINED = 0.6
"""Share of the closed surface that nobody scanned from which on a warning says how much of it was right so far."""
_LOST_VOXELS, _LOST_SHARE = 2.0, 0.05
"""Points this many voxels off the closed surface are lost; a warning tells where more than this share is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedScan(FlaggedMesh):
    """A closed scan, with what was taken for granted to close it."""

    method: str
    """What filled the unknown: smooth, convex, hull, lite or osc."""
    imagined: float
    """Share of the surface's area where there were no points. [0, 1]"""
    up: Float64[np.ndarray, "3"]
    """Direction that was taken for up, scan's frame."""
    assumed: tuple[str, ...]
    """What was found out or taken for granted about the scan, in words."""


def complete_scan(cloud: PointCloud, config: ScanConfig, notify: Listener = ignore) -> ClosedScan:
    """Close a partial scan: the surface stays on its points, and what no sensor saw past may be solid.

    The scan is turned upright for this, and the result turned back. From a viewpoint, given or found, space that its
    rays passed stays empty. A scan that ends in an upright plane is half a thing: the other half is a copy.

    Args:
        cloud: any frame and unit; normals outwards, estimated where there are none.
        config: what fills the unknown, how finely, and what is known of the scan.
        notify: hears warnings.

    Returns:
        A watertight mesh (checked) in the scan's frame, colours carried over; `observed` where there were points.

    Raises:
        CompleteError: fewer than 50 points, no extent, no inside; a viewpoint among the points, or behind the surface;
            or a network that cannot be used.
    """
    scan = posed(cleaned(cloud, notify), config)
    beyond = supposed(scan, config) if config.copies and config.method != "hull" else Supposed()
    found = seen_of(scan, config.cells, beyond.places)
    fill = scan_fill(found, scan, beyond, config)
    done = compose(found, fill.distance)
    flaw = watertight_flaw(done.mesh)
    if flaw is not None:
        raise CompleteError(f"The scan cannot be closed: {flaw}. Check that its normals point outwards.")
    closed = _turned_back(done, scan, fill, beyond)
    _check_observed(closed, config.method == "auto", notify)
    _tell_lost(scan.cloud.positions, done.mesh, found.evidence.voxel, notify)
    return closed


def _turned_back(done: FlaggedMesh, scan: PosedScan, fill: ScanFill, beyond: Supposed) -> ClosedScan:
    areas = face_areas(done.mesh)
    whole = done.observed[done.mesh.faces].all(axis=1)
    return ClosedScan(
        mesh=replace(done.mesh, vertices=(done.mesh.vertices @ scan.level_from_scan).astype(np.float32)),
        observed=done.observed,
        method=fill.method,
        imagined=float(1 - areas[whole].sum() / areas.sum()),
        up=scan.level_from_scan[2],
        assumed=(*scan.assumed, *beyond.words, *fill.reasons),
    )


def _check_observed(closed: ClosedScan, chosen: bool, notify: Listener) -> None:
    share = 1 - closed.imagined
    if share < _LEAST_OBSERVED:
        raise CompleteError(
            f"{share:.1%} of the closed surface is the scan's own: its normals look inwards. Turn them "
            "round, or pass --viewpoint, where the sensor stood."
        )
    if share < _LITTLE_OBSERVED:
        message = f"Only {share:.0%} of the closed surface was scanned: nearly all of it is imagined."
        notify(Warned(stage="complete", message=message))
    elif closed.imagined > _MUCH_IMAGINED and chosen:
        message = (
            f"{closed.imagined:.0%} of the surface is imagined. In scans like this, half of it came out within 2 % of "
            "the thing's size, and one in four was further from the truth than its convex hull (--method convex)."
        )
        notify(Warned(stage="complete", message=message))


def _tell_lost(points: Float32[np.ndarray, "p 3"], closed: Mesh, voxel: float, notify: Listener) -> None:
    off = cKDTree(closed.vertices).query(points)[0]
    lost = float((off > _LOST_VOXELS * voxel).mean())
    if lost > _LOST_SHARE:
        message = (
            f"{lost:.0%} of the scan's points are not on the closed surface: walls thinner than a voxel "
            f"({voxel:.3g}) vanish, and so do pieces apart from the rest. Raise --cells."
        )
        notify(Warned(stage="complete", message=message))
