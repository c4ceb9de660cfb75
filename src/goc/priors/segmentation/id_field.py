"""Looks up the id of any 3D point from the ids of voxels; the answer does not depend on the view."""

import math

import numpy as np
from jaxtyping import Float, Int16, Int64
from scipy.spatial import cKDTree

from goc.geometry.voxels import HALF, cells_of, dilate, find_keys, pack_cells
from goc.priors.segmentation.surface_voxels import MARGIN, SurfaceVoxels
from goc.scene import UNLABELLED

MIXED = -2
"""Marks a cell next to which there are several ids, so that the nearest voxel has to be searched for."""


class IdField:
    """Id of a point: that of the nearest labelled voxel within `reach` voxels, else UNLABELLED."""

    def __init__(self, surface: SurfaceVoxels, ids: Int64[np.ndarray, "v"], reach: float) -> None:
        kept = ids != UNLABELLED
        self._voxel = surface.voxel
        self._reach = reach * surface.voxel
        self._ids = ids[kept].astype(np.int16)
        self._tree = cKDTree(surface.points[kept])
        self._keys, near = dilate(surface.keys[kept], self._ids, math.ceil(reach))
        self._plain = self._settle(near)

    def _settle(self, near: np.ndarray) -> np.ndarray:
        """Ids of cells all of whose neighbours agree; MIXED elsewhere."""
        plain = near.copy()
        for axis in range(3):
            for step in (-(1 << 21 * axis), 1 << 21 * axis):
                rows = find_keys(self._keys, self._keys + step)
                plain[(rows >= 0) & (near[rows] != near)] = MIXED
        return plain

    def __call__(self, points: Float[np.ndarray, "p 3"]) -> Int16[np.ndarray, "p"]:
        """Ids of finite points."""
        reach = (HALF - MARGIN) * self._voxel
        rows = find_keys(self._keys, pack_cells(cells_of(np.clip(points, -reach, reach), self._voxel)))
        ids = np.where(rows >= 0, self._plain[rows], UNLABELLED)
        asked = np.flatnonzero(ids == MIXED)
        distance, nearest = self._tree.query(points[asked], distance_upper_bound=self._reach)
        hit = np.isfinite(distance)
        ids[asked] = UNLABELLED
        ids[asked[hit]] = self._ids[nearest[hit]]
        return ids.astype(np.int16)
