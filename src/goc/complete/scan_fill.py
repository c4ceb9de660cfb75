"""What fills the unknown space of a scan, and why."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64

from goc.complete.compose import Measured, compose, compose_field, with_margin
from goc.complete.config import ScanConfig
from goc.complete.convex import convex_fill
from goc.complete.copies import new_places, with_copy
from goc.complete.partial import bounding_cube
from goc.complete.poisson import poisson_fill
from goc.complete.scan_copies import Supposed
from goc.complete.scan_evidence import measured_scan
from goc.complete.scan_pose import PosedScan
from goc.complete.stage import model_fill, network_for
from goc.device import working_device
from goc.geometry.surfaces import face_areas
from goc.scene import Evidence, EvidenceGrid, PointCloud

_COARSE_CELLS = 64
_LITE_SHARE = 2 / 3
_MOST_SPILLED = 0.6
"""What the network may fill beyond the convex hull, in volumes of what that fills; more was wrong in 15 scans of 18."""
_ODDS = "of scans like this, one in five was further from the truth than its convex hull"
"""10 of 46, measured on splits train and val (docs/decisions/0047)."""
Places = Float64[np.ndarray, "q 3"] | None
_SMALL_HOLES = 0.25
"""Share of the closed surface that nobody measured up to which a scan is nearly whole."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanFill:
    """A fill as `compose` takes it, and what it is."""

    distance: Float32[np.ndarray, "x y z"] | None
    """Signed, in voxels of `with_margin`; None: all that is not seen empty is solid."""
    method: str
    reasons: tuple[str, ...] = ()
    """Why this method, in words; empty where it was asked for."""


def scan_fill(found: Measured, scan: PosedScan, beyond: Supposed, config: ScanConfig) -> ScanFill:
    """What fills the unknown space of a scan.

    `auto` closes small holes smoothly. Where much is open, the surface lies between the convex hull of the points and
    the network's: alone, each is far off for some kinds of things. A network that fills far more than the hull is not
    believed, and half a thing that nothing joins is the network's alone (docs/decisions/0047).

    Args:
        found: what was measured; its grid holds the copies.
        scan: the points that it was measured from.
        beyond: what stands in for the rest of the thing, and where it may be.
        config: names the method.

    Raises:
        CompleteError: a network that cannot be used.
    """
    whole, cloud = found, scan.cloud
    for copy in beyond.copies:
        cloud = with_copy(cloud, copy, new_places(cloud, copy, found.evidence))
    if beyond.copies:
        whole = _with_empty_of(measured_scan(cloud, blank(found.evidence)), found.evidence)
    alone = beyond.places if not beyond.copies else None
    fill = _auto(whole, cloud, config, alone) if config.method == "auto" else _asked(whole, cloud, config, alone)
    if not beyond.copies or fill.distance is None:
        return fill
    return replace(fill, distance=compose_field(with_margin(whole.evidence), fill.distance, cloud.positions).distance)


def _asked(whole: Measured, cloud: PointCloud, config: ScanConfig, places: Places) -> ScanFill:
    distance = None if config.method == "hull" else method_fill(config.method, whole, cloud, config, places)
    return ScanFill(distance=distance, method=config.method)


def _auto(whole: Measured, cloud: PointCloud, config: ScanConfig, places: Places) -> ScanFill:
    if places is not None:  # all others would close the half with a lid
        return ScanFill(distance=method_fill("lite", whole, cloud, config, places), method="lite")
    smooth = method_fill("smooth", whole, cloud, config)
    share = _imagined(whole, smooth)
    if share < _SMALL_HOLES:
        return ScanFill(distance=smooth, method="smooth", reasons=(f"small holes, {share:.0%} of the surface",))
    convex, lite = (method_fill(method, whole, cloud, config) for method in ("convex", "lite"))
    if _spilled(whole, convex, lite) > _MOST_SPILLED:
        reason = "the network fills far more than the convex hull of the points: not believed"
        return ScanFill(distance=convex, method="convex", reasons=(reason,))
    blend = np.float32(_LITE_SHARE) * lite + np.float32(1 - _LITE_SHARE) * convex
    return ScanFill(distance=blend, method="lite by two thirds, convex by one", reasons=(_ODDS,))


def _spilled(whole: Measured, convex: Float32[np.ndarray, "x y z"], lite: Float32[np.ndarray, "x y z"]) -> float:
    """Unknown space that the network fills beyond the convex hull, in volumes of what the hull fills."""
    unknown = with_margin(whole.evidence).state == Evidence.UNKNOWN
    hull = (convex < 0) & unknown
    return float(((lite < 0) & unknown & ~hull).sum() / max(int(hull.sum()), 1))


def _imagined(whole: Measured, fill: Float32[np.ndarray, "x y z"]) -> float:
    """Share of the surface of a fill that nobody measured."""
    bare = replace(whole, mesh=replace(whole.mesh, colours=None))  # nobody looks at it
    done = compose(bare, fill)
    if not len(done.mesh.faces):
        return 1.0
    areas = face_areas(done.mesh)
    return float(areas[~done.observed[done.mesh.faces].all(axis=1)].sum() / areas.sum())


def method_fill(
    method: str, whole: Measured, cloud: PointCloud, config: ScanConfig, places: Places = None
) -> Float32[np.ndarray, "x y z"]:
    """What one method fills in; a network is asked in a cube that holds `places` as well."""
    assert cloud.normals is not None
    if method == "convex":
        return convex_fill(whole)
    if method == "smooth":
        return poisson_fill(cloud.positions, cloud.normals, with_margin(whole.evidence))
    model = network_for(method, config.weights, working_device())
    points = cloud.positions if places is None else np.concatenate([cloud.positions, places])
    return model_fill(model, whole, cloud.normals, config.threshold, _COARSE_CELLS, cube=bounding_cube(points))


def blank(grid: EvidenceGrid) -> EvidenceGrid:
    """The same grid, of which nothing is known."""
    return replace(grid, state=np.zeros_like(grid.state), sdf=np.zeros_like(grid.sdf))


def _with_empty_of(whole: Measured, known: EvidenceGrid) -> Measured:
    """Measured surface, and its copies where no ray passed."""
    empty = known.state == Evidence.EMPTY
    state = np.where(empty, known.state, whole.evidence.state)
    return replace(whole, evidence=replace(whole.evidence, state=state, sdf=np.where(empty, 0, whole.evidence.sdf)))
