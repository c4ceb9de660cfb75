"""Completes one partial point cloud, which has no evidence but its points and, if given, the sensor's position."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float32, Float64
from scipy.spatial import cKDTree

from goc.complete.compose import Measured, compose, with_margin
from goc.complete.config import ScanConfig
from goc.complete.hull import BAND
from goc.complete.poisson import poisson_fill
from goc.complete.stage import model_fill, network_for
from goc.complete.viewpoint import carve_free_space, facing
from goc.device import working_device
from goc.errors import CompleteError
from goc.events import Listener, Warned, ignore
from goc.geometry.orientation import point_normals
from goc.geometry.topology import watertight_flaw
from goc.scene import Evidence, EvidenceGrid, FlaggedMesh, Mesh, PointCloud

_FEWEST, _MOST = 50, 200_000
_NEAREST = 8
_ROOM = 0.125
"""Room round the points, longest sides."""
_LEAST_OBSERVED = 0.005
"""Least share of the closed surface that lies on the scan: below, normals look inwards and a shell was closed."""
_LOST_VOXELS, _LOST_SHARE = 2.0, 0.05
"""Points this many voxels off the closed surface are lost; a warning tells where more than this share is."""
_OUTLIER_DISTANCE = 6.0
"""Points whose mean distance to their neighbours is this many times the median are outliers."""


def complete_scan(cloud: PointCloud, config: ScanConfig, notify: Listener = ignore) -> FlaggedMesh:
    """Close a partial point cloud.

    Without a viewpoint nothing is known to be empty, and the evidence hull would be a box. So the surface goes on as
    smoothly as the normals ask (Poisson), or as a network has it; where points are, it stays on them. From a viewpoint,
    space that its rays passed stays empty.

    Args:
        cloud: any frame and unit; normals outwards, estimated where there are none.
        config: what fills the unknown, and how finely.
        notify: hears warnings.

    Returns:
        A watertight mesh (checked), colours carried over; `observed` where there were points.

    Raises:
        CompleteError: fewer than 50 points, no extent, no inside; a viewpoint among the points, or behind the surface;
            or a network that cannot be used.
    """
    viewpoint = None if config.viewpoint is None else np.array(config.viewpoint, np.float64)
    cloud = _prepared(cloud, viewpoint, notify)
    found = measured_scan(cloud, config.cells)
    if viewpoint is not None:
        found = replace(found, evidence=carve_free_space(found.evidence, cloud.positions, viewpoint))
    assert cloud.normals is not None
    fill = None
    if config.method == "smooth":
        fill = poisson_fill(cloud.positions, cloud.normals, with_margin(found.evidence))
    elif config.method != "hull":
        model = network_for(config.method, config.weights, working_device())
        fill = model_fill(model, found, cloud.normals, config.threshold, coarse_cells=64)
    done = compose(found, fill)
    flaw = watertight_flaw(done.mesh)
    if flaw is not None:
        raise CompleteError(f"The scan cannot be closed: {flaw}. Check that its normals point outwards.")
    if done.observed.mean() < _LEAST_OBSERVED:
        raise CompleteError(
            f"{done.observed.mean():.1%} of the closed surface is the scan's own: its normals look inwards. Turn them "
            "round, or pass --viewpoint, where the sensor stood."
        )
    _tell_lost(cloud.positions, done.mesh, found.evidence.voxel, notify)
    return done


def _tell_lost(points: Float32[np.ndarray, "p 3"], closed: Mesh, voxel: float, notify: Listener) -> None:
    off = cKDTree(closed.vertices).query(points)[0]
    lost = float((off > _LOST_VOXELS * voxel).mean())
    if lost > _LOST_SHARE:
        message = (
            f"{lost:.0%} of the scan's points are not on the closed surface: walls thinner than a voxel "
            f"({voxel:.3g}) vanish, and so do pieces apart from the rest. Raise --cells."
        )
        notify(Warned(stage="complete", message=message))


def _prepared(cloud: PointCloud, viewpoint: Float64[np.ndarray, "3"] | None, notify: Listener) -> PointCloud:
    """Remove outliers, thin the points out to 200,000, and give them outward normals where they have none."""
    count = len(cloud.positions)
    if count < _FEWEST or not np.ptp(cloud.positions, axis=0).max() > 0:
        raise CompleteError(f"{count} points tell no surface: {_FEWEST} are needed, in more than one place.")
    cleaned = without_outliers(cloud)
    if len(cleaned.positions) < count:
        message = f"{count - len(cleaned.positions)} of {count} points lie far from all others: left out."
        notify(Warned(stage="complete", message=message))
    if len(cleaned.positions) > _MOST:
        cleaned = _chosen(cleaned, np.random.default_rng(0).permutation(len(cleaned.positions))[:_MOST])
    if cleaned.normals is not None:
        lengths = np.linalg.norm(cleaned.normals, axis=1, keepdims=True)
        if (lengths > 0.5).all():
            normals = (cleaned.normals / lengths).astype(np.float32)
            if viewpoint is not None:
                _check_sides(normals, cleaned.positions, viewpoint)
            return replace(cleaned, normals=normals)
    normals = point_normals(cleaned.positions)
    if viewpoint is not None:
        normals = facing(normals, cleaned.positions, viewpoint)
    return replace(cleaned, normals=normals)


def _check_sides(
    normals: Float32[np.ndarray, "p 3"], points: Float32[np.ndarray, "p 3"], viewpoint: Float64[np.ndarray, "3"]
) -> None:
    away = float(((normals * (viewpoint - points)).sum(axis=1) < 0).mean())
    if away > 0.5:
        raise CompleteError(
            f"{away:.0%} of the scan's normals look away from --viewpoint, so it saw the inside. Turn the faces or "
            "normals round, or leave the normals out."
        )


def _chosen(cloud: PointCloud, rows: np.ndarray) -> PointCloud:
    normals = None if cloud.normals is None else cloud.normals[rows]
    return replace(cloud, positions=cloud.positions[rows], colours=cloud.colours[rows], normals=normals)


def without_outliers(cloud: PointCloud) -> PointCloud:
    """Drop points that lie far from all others."""
    apart = cKDTree(cloud.positions).query(cloud.positions, k=min(_NEAREST + 1, len(cloud.positions)))[0][:, 1:]
    off = apart.mean(axis=1)
    return _chosen(cloud, off <= _OUTLIER_DISTANCE * max(float(np.median(off)), 1e-30))


def measured_scan(cloud: PointCloud, cells: int) -> Measured:
    """What a scan measured, from points with outward normals: the points, and evidence round them.

    Voxels near points hold the distance to the planes of the nearest ones (a Gaussian mean, so that noise evens out).
    No ray is known, so nothing is seen empty.

    Args:
        cloud: positions and unit normals.
        cells: voxels along the longest side of the points' box; fewer where points lie further apart than that.
    """
    points = cloud.positions.astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float((high - low).max())
    tree = cKDTree(points)
    spacing = float(np.median(tree.query(points, k=2)[0][:, 1]))
    voxel = max(longest / cells, spacing)
    room = _ROOM * longest + 2 * voxel
    shape = np.ceil((high - low + 2 * room) / voxel).astype(int) + 1
    blank = EvidenceGrid(
        origin=low - room,
        voxel=voxel,
        state=np.zeros(shape, np.uint8),
        sdf=np.zeros(shape, np.float32),
    )
    mesh = Mesh(vertices=cloud.positions, faces=np.zeros((0, 3), np.int32), colours=cloud.colours)
    return Measured(mesh=mesh, evidence=_measured(blank, points, cloud.normals, tree))


def _measured(
    blank: EvidenceGrid,
    points: Float64[np.ndarray, "p 3"],
    normals: Float32[np.ndarray, "p 3"] | None,
    tree: cKDTree,
) -> EvidenceGrid:
    assert normals is not None
    voxel = blank.voxel
    index = _around(points, blank, round(BAND))
    places = blank.origin + voxel * index
    apart, near = tree.query(places, k=min(_NEAREST, len(points)))
    apart, near = apart.reshape(len(places), -1), near.reshape(len(places), -1)
    offset = places[:, None] - points[near]
    height = (offset * normals[near]).sum(axis=-1)
    weight = np.exp(-0.5 * ((apart - apart[:, :1]) / voxel) ** 2)
    distance = (weight * height).sum(axis=1) / weight.sum(axis=1)
    aside = np.sqrt(np.maximum(apart[:, 0] ** 2 - height[:, 0] ** 2, 0.0))
    beside = (aside < 1.5 * voxel) & (np.abs(distance) < BAND * voxel)  # over the points, not past their border
    at = tuple(index[beside].T)
    state, sdf = blank.state.copy(), blank.sdf.copy()
    state[at] = Evidence.SURFACE
    sdf[at] = distance[beside]
    return replace(blank, state=state, sdf=sdf)


def _around(points: Float64[np.ndarray, "p 3"], grid: EvidenceGrid, reach: int) -> np.ndarray:
    """Voxels at most `reach` steps along each axis from one that holds a point."""
    near = np.zeros(grid.state.shape, bool)
    near[tuple(np.rint((points - grid.origin) / grid.voxel).astype(int).T)] = True
    for axis in range(3):
        lines = np.moveaxis(near, axis, 0)
        wide = lines.copy()
        for step in range(1, reach + 1):
            wide[step:] |= lines[:-step]
            wide[:-step] |= lines[step:]
        near = np.moveaxis(wide, 0, axis)
    return np.argwhere(near)
