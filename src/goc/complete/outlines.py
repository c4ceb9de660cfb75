"""The outlines of what was measured, extruded: most of what people make is bounded so, and boxes are."""

import numpy as np
from jaxtyping import Float32, Float64
from scipy import ndimage
from scipy.spatial.transform import Rotation

from goc.complete.compose import Measured, with_margin
from goc.complete.convex import asked_voxels
from goc.complete.hull import BAND
from goc.geometry.surfaces import vertex_normals
from goc.scene import EvidenceGrid

Grid = Float32[np.ndarray, "x y z"]

_FEWEST = 60
"""Measured points without which no shape is fitted."""
_NORMALS = 3000
"""Normals that a fit looks at."""
_CLOSING = 3
"""Cells over which the silhouette's raster is closed."""


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


def outline_fill(found: Measured, axes: Float64[np.ndarray, "3 3"]) -> Grid | None:
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
