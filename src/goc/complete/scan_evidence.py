"""Evidence round the points of a scan: signed distance near them, everything else unknown."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy.spatial import cKDTree

from goc.complete.compose import Measured
from goc.complete.hull import BAND
from goc.scene import Evidence, EvidenceGrid, Mesh, PointCloud

_NEAREST = 8
_ROOM = 0.125
"""Room round the points, longest sides."""


def scan_grid(
    points: Float[np.ndarray, "p 3"], cells: int, others: Float[np.ndarray, "q 3"] | None = None
) -> EvidenceGrid:
    """A grid of unknown voxels round points, with some room.

    Args:
        points: of the scan.
        cells: voxels along the longest side of the points' box; fewer where points lie further apart than that.
        others: places that the grid has to hold as well, such as where the other half of a thing may be.
    """
    points = points.astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float((high - low).max())
    spacing = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    voxel = max(longest / cells, spacing)
    if others is not None and len(others):
        low, high = np.minimum(low, others.min(axis=0)), np.maximum(high, others.max(axis=0))
    room = _ROOM * longest + 2 * voxel
    shape = np.ceil((high - low + 2 * room) / voxel).astype(int) + 1
    return EvidenceGrid(
        origin=low - room, voxel=voxel, state=np.zeros(shape, np.uint8), sdf=np.zeros(shape, np.float32)
    )


def measured_scan(cloud: PointCloud, grid: EvidenceGrid) -> Measured:
    """What a scan measured, from points with outward normals: the points, and evidence round them.

    Voxels near points hold the distance to the planes of the nearest ones (a Gaussian mean, so that noise evens out).
    No ray is known, so nothing is seen empty.

    Args:
        cloud: positions and unit normals, inside the grid.
        grid: unknown voxels.
    """
    mesh = Mesh(vertices=cloud.positions, faces=np.zeros((0, 3), np.int32), colours=cloud.colours)
    return Measured(mesh=mesh, evidence=_near_points(grid, cloud.positions.astype(np.float64), cloud.normals))


def _near_points(
    blank: EvidenceGrid, points: Float64[np.ndarray, "p 3"], normals: Float32[np.ndarray, "p 3"] | None
) -> EvidenceGrid:
    assert normals is not None
    voxel = blank.voxel
    index = _around(points, blank, round(BAND))
    places = blank.origin + voxel * index
    apart, near = cKDTree(points).query(places, k=min(_NEAREST, len(points)))
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
