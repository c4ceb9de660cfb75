"""Fills from what things often are: boxes, extrusions, surfaces of revolution. No learning; each may be refuted."""

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy import ndimage
from scipy.spatial.transform import Rotation

from goc.complete.compose import Measured, with_margin
from goc.complete.convex import asked_voxels
from goc.complete.hull import BAND
from goc.geometry.surfaces import vertex_normals
from goc.scene import Evidence, EvidenceGrid

Grid = Float32[np.ndarray, "x y z"]

_FEWEST = 60
"""Measured points without which no shape is fitted."""
_NORMALS = 3000
"""Normals that a fit looks at."""
_OUTLIERS = 0.002
"""Share of the points at either end of an axis that a box may leave out: stray measurements."""
_CLOSING = 3
"""Cells over which the silhouette's raster is closed."""
_EVEN = 0.25
"""Share of a ring's known voxels that may be in its minority before the ring tells nothing."""


def square_axes(found: Measured) -> Float64[np.ndarray, "3 3"]:
    """Three perpendicular directions that most of the measured normals follow, as rows (a Manhattan frame).

    From several starts, each normal is given to its nearest axis and the frame turned to fit (Procrustes), in turns.
    """
    normals = _some_normals(found)
    starts = [Rotation.identity()] + [
        Rotation.from_euler(axis, angle, degrees=True) for axis in "xyz" for angle in (22.5, 45.0, 67.5)
    ]
    best, least = np.eye(3), -1.0
    for start in starts:
        axes = start.as_matrix()
        for _ in range(8):
            along = normals @ axes.T
            nearest = np.abs(along).argmax(axis=1)
            way = np.sign(along[np.arange(len(along)), nearest])
            strong = np.abs(along).max(axis=1) ** 4  # those that follow no axis say little
            pull = np.zeros((3, 3))
            np.add.at(pull, nearest, normals * (way * strong)[:, None])
            left, _, right = np.linalg.svd(pull + 1e-9 * axes)
            axes = left @ right
        fit = float((np.abs(normals @ axes.T).max(axis=1) ** 8).mean()) if len(normals) else 0.0
        if fit > least + 1e-6:
            best, least = axes, fit
    return best


def box_fill(found: Measured, axes: Float64[np.ndarray, "3 3"]) -> Grid | None:
    """The box round what was measured, its sides along the axes; None where too little was measured."""
    if len(found.mesh.vertices) < _FEWEST:
        return None
    grid = with_margin(found.evidence)
    along = found.mesh.vertices.astype(np.float64) @ axes.T
    low, high = np.quantile(along, [_OUTLIERS, 1 - _OUTLIERS], axis=0)
    result, asked, places = _asked(grid)
    off = np.abs(places @ axes.T - (low + high) / 2) - (high - low) / 2
    outside = np.linalg.norm(np.maximum(off, 0.0), axis=1)
    result[asked] = _in_band((outside + np.minimum(off.max(axis=1), 0.0)) / grid.voxel)
    return result


def silhouette_fill(found: Measured, axes: Float64[np.ndarray, "3 3"]) -> Grid | None:
    """What the measured surface's outlines along the three axes leave standing: each is extruded, and all are cut."""
    if len(found.mesh.vertices) < _FEWEST:
        return None
    grid = with_margin(found.evidence)
    along = found.mesh.vertices.astype(np.float64) @ axes.T
    result, asked, places = _asked(grid)
    turned = places @ axes.T
    furthest = np.full(len(turned), -BAND)
    for axis in range(3):
        kept = [other for other in range(3) if other != axis]
        furthest = np.maximum(furthest, _outline(along[:, kept], turned[:, kept], grid.voxel))
    result[asked] = _in_band(furthest)
    return result


def _outline(
    points: Float64[np.ndarray, "p 2"], places: Float64[np.ndarray, "q 2"], voxel: float
) -> Float64[np.ndarray, "q"]:
    """Signed distance, in voxels, of places to the filled outline of points."""
    edge = _CLOSING + 4
    low = points.min(axis=0) - edge * voxel
    shape = np.ceil((points.max(axis=0) - low) / voxel).astype(int) + edge + 1
    mask = np.zeros(shape, bool)
    mask[tuple(np.rint((points - low) / voxel).astype(int).T)] = True
    disc = ndimage.generate_binary_structure(2, 1)
    mask = ndimage.binary_closing(mask, disc, iterations=_CLOSING)
    mask = ndimage.binary_fill_holes(mask)
    away = ndimage.distance_transform_edt(~mask) - ndimage.distance_transform_edt(mask)
    away -= 0.5 * np.sign(away)
    return ndimage.map_coordinates(away, ((places - low) / voxel).T, order=1, mode="nearest")


def revolution_axis(found: Measured) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]] | None:
    """Point on and direction of the axis that the measured normals point to; None where too little was measured.

    Normals of a surface of revolution meet its axis: a linear complex (Pottmann and Randrup 1998), fitted to points and
    normals by least squares, twice, the second time without what lies far off.
    """
    points, normals = found.mesh.vertices.astype(np.float64), vertex_normals(found.mesh).astype(np.float64)
    rows = np.random.default_rng(0).permutation(len(points))[:_NORMALS]
    points, normals = points[rows], normals[rows]
    kept = np.linalg.norm(normals, axis=1) > 0.5
    if kept.sum() < _FEWEST:
        return None
    points, normals = points[kept], normals[kept]
    centre, scale = points.mean(axis=0), float(np.ptp(points, axis=0).max()) / 2
    lines = np.concatenate([np.cross((points - centre) / scale, normals), normals], axis=1)
    weight = np.ones(len(lines))
    direction, moment = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    for _ in range(6):
        total = (lines * weight[:, None]).T @ lines / weight.sum()
        reduced = np.linalg.pinv(total[3:, 3:], rcond=1e-4) @ total[3:, :3]
        left = total[:3, :3] - total[:3, 3:] @ reduced
        direction = np.linalg.eigh((left + left.T) / 2)[1][:, 0]
        moment = -reduced @ direction
        off = np.abs(lines @ np.concatenate([direction, moment]))
        weight = 1.0 / (1.0 + (off / (np.median(off) + 1e-3)) ** 2)
    return centre + scale * np.cross(direction, moment), direction


def revolved_fill(
    found: Measured, point: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"], base: Grid
) -> tuple[Grid, float]:
    """What was measured, turned round an axis, and the share of it that contradicts itself.

    Voxels at the same height and distance from the axis make a ring; where the known ones of a ring agree, the others
    take their mean distance.

    Args:
        found: any frame.
        point: on the axis.
        direction: unit, of the axis.
        base: a fill for rings of which nothing is known.
    """
    grid = with_margin(found.evidence)
    index = np.argwhere(np.ones(grid.state.shape, bool))
    off = (grid.origin - point + grid.voxel * index) / grid.voxel
    height = off @ direction
    radius = np.sqrt(np.maximum((off**2).sum(axis=1) - height**2, 0.0))
    row = np.rint(height - height.min()).astype(np.int64)
    wide = int(radius.max()) + 2
    ring = row * wide + np.rint(radius).astype(np.int64)
    state = grid.state.ravel()
    seen, known = state == Evidence.SURFACE, state != Evidence.UNKNOWN
    told = np.where(seen, np.clip(grid.sdf.ravel() / grid.voxel, -BAND, BAND), BAND)
    rings = (int(row.max()) + 1) * wide
    count = np.bincount(ring[known], minlength=rings)
    solid = np.bincount(ring[known], told[known] < 0, minlength=rings)
    mean = np.bincount(ring[known], told[known], minlength=rings) / np.maximum(count, 1)
    minority = np.minimum(solid, count - solid) / np.maximum(count, 1)
    touched = np.bincount(ring[seen], minlength=rings) > 0
    wrong = float((minority * count)[touched].sum() / max(count[touched].sum(), 1))
    sure = (count >= 3) & (minority < _EVEN)
    filled = np.where(sure[ring], mean[ring], base.ravel()).astype(np.float32)
    return filled.reshape(grid.state.shape), wrong


def _some_normals(found: Measured) -> Float64[np.ndarray, "n 3"]:
    normals = vertex_normals(found.mesh).astype(np.float64)
    rows = np.random.default_rng(0).permutation(len(normals))[:_NORMALS]
    return normals[rows][np.linalg.norm(normals[rows], axis=1) > 0.5]


def _asked(grid: EvidenceGrid) -> tuple[Grid, np.ndarray, Float64[np.ndarray, "q 3"]]:
    """An empty field, the voxels that may be solid, and where these are."""
    asked = asked_voxels(grid)
    field = np.full(grid.state.shape, np.float32(BAND))
    return field, asked, grid.origin + grid.voxel * np.argwhere(asked)


def _in_band(distance: Float64[np.ndarray, "q"]) -> Float32[np.ndarray, "q"]:
    return np.clip(distance, -BAND, BAND).astype(np.float32)
