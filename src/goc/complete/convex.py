"""The convex hull of what was seen, as a fill: the strongest completion that needs no training."""

import numpy as np
from jaxtyping import Bool, Float32
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from goc.complete.compose import Measured, with_margin
from goc.complete.hull import BAND
from goc.geometry.raycast import TriangleScene
from goc.scene import Evidence, EvidenceGrid

_LATTICE = 3
"""Every third voxel along each axis is asked even where rays passed, to tell how far they refute a proposal."""


def asked_voxels(grid: EvidenceGrid) -> Bool[np.ndarray, "x y z"]:
    """Voxels at which a proposal is worked out: all that may be solid, and next to it, and a lattice of the rest."""
    asked = ndimage.binary_dilation(grid.state != Evidence.EMPTY, np.ones((3, 3, 3)))
    asked[::_LATTICE, ::_LATTICE, ::_LATTICE] = True
    return asked


def refuted_share(fill: Float32[np.ndarray, "x y z"], grid: EvidenceGrid) -> float:
    """Share of a proposal's solid that rays passed, 0 to 1, counted on the lattice."""
    solid, state = (field[::_LATTICE, ::_LATTICE, ::_LATTICE] for field in (fill < 0, grid.state))
    return float((solid & (state == Evidence.EMPTY)).sum() / max(int(solid.sum()), 1))


def nothing_fill(found: Measured) -> Float32[np.ndarray, "x y z"]:
    """Fill nothing: outside wherever no surface was measured."""
    return np.full(with_margin(found.evidence).state.shape, np.float32(BAND))


def convex_fill(found: Measured) -> Float32[np.ndarray, "x y z"]:
    """Exact distance to the convex hull of what was seen, in voxels of `with_margin`; nothing where that is flat."""
    grid, result = with_margin(found.evidence), nothing_fill(found)
    try:
        hull = ConvexHull(found.mesh.vertices.astype(np.float64))
    except QhullError:
        return result
    corners = hull.points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turned = (normals * hull.equations[:, :3]).sum(axis=1) < 0
    faces = np.where(turned[:, None], hull.simplices[:, ::-1], hull.simplices).astype(np.int32)
    scene = TriangleScene(found.mesh.vertices, faces)
    asked = asked_voxels(grid)
    points = grid.origin + grid.voxel * np.argwhere(asked)
    apart, _ = scene.nearest(points, BAND * grid.voxel)
    sign = np.where(scene.winding(points) > 0, -1.0, 1.0)
    result[asked] = sign * np.minimum(apart / grid.voxel, BAND)
    return result
