"""Which mask of which frame covers which voxel of the surface."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import csr_array

from goc.events import Listener, Progress
from goc.geometry.voxels import HALF, cells_of, dilate, find_keys, pack_cells
from goc.priors.segmentation.surface_voxels import MARGIN, SurfaceVoxels, back_project, by_name, depth_of
from goc.scene import UNLABELLED, Capture, Frame

SAMPLES = 40_000
"""Pixels that are looked at in a view, about."""
CLEAR = 0.6
"""A voxel belongs to the mask that covers more than this share of its pixels in a view; else to none, as on borders."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Masks:
    """All masks of a capture, ordered by the names of their views and by id. A mask is one id in one view."""

    frames: Int64[np.ndarray, "m"]
    """View of each mask."""
    given: Int64[np.ndarray, "m"]
    """Its id as it was given; masks of what is unlabelled are there too, but have no vote."""
    covers: csr_array
    """Masks × voxels, 1 where a mask covers a voxel. In one view no voxel is covered twice."""

    @property
    def votes(self) -> Bool[np.ndarray, "m"]:
        """Whether a mask has a vote."""
        return self.given != UNLABELLED


class VoxelFinder:
    """The voxel at or next to which a point lies."""

    def __init__(self, surface: SurfaceVoxels, reach: float) -> None:
        self._voxel = surface.voxel
        self._keys, self._rows = dilate(surface.keys, np.arange(len(surface)), math.ceil(reach))

    def __call__(self, points: Float64[np.ndarray, "p 3"]) -> Int64[np.ndarray, "p"]:
        """Row of the voxel of finite points, -1 where none is near."""
        far = (HALF - MARGIN) * self._voxel
        found = find_keys(self._keys, pack_cells(cells_of(np.clip(points, -far, far), self._voxel)))
        return np.where(found >= 0, self._rows[found], -1)


def find_masks(views: Capture, surface: SurfaceVoxels, reach: float, notify: Listener) -> Masks:
    """Collect the masks of all views, in the order of the views' names.

    Args:
        views: with metric depth and ids; views that lack one have no masks.
        surface: fused from these views.
        reach: how far from a voxel a point may lie, in voxels.
        notify: hears of progress.
    """
    finder = VoxelFinder(surface, reach)
    frames, given, rows, columns = [], [], [], []
    for done, index in enumerate(by_name(views), 1):
        voxels, ids = _covered(views[index], finder)
        present, which = np.unique(ids, return_inverse=True)
        rows.append(which + sum(map(len, given)))
        columns.append(voxels)
        frames.append(np.full(len(present), index))
        given.append(present)
        notify(Progress(stage="ids", done=done, total=len(views)))
    row, column = np.concatenate(rows), np.concatenate(columns)
    count = sum(map(len, given))
    covers = csr_array((np.ones(len(row), np.float32), (row, column)), shape=(count, len(surface)))
    return Masks(
        frames=np.concatenate(frames).astype(np.int64), given=np.concatenate(given).astype(np.int64), covers=covers
    )


def _covered(frame: Frame, finder: VoxelFinder) -> tuple[Int64[np.ndarray, "n"], Int64[np.ndarray, "n"]]:
    """Voxels that a view sees, and the id of the mask that covers each."""
    z = depth_of(frame)
    if z is None or frame.ids is None:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    stride = max(1, int(math.sqrt(z.size / SAMPLES)))
    seen = np.isfinite(z[::stride, ::stride])
    ids = frame.ids.numpy()[::stride, ::stride][seen].astype(np.int64)
    voxels = finder(back_project(z, frame.camera, stride)[seen])
    pairs, counts = np.unique((voxels[voxels >= 0] << 16) + (ids[voxels >= 0] + 1), return_counts=True)
    rows, of = np.unique(pairs >> 16, return_inverse=True)
    share = counts / np.bincount(of, counts, len(rows))[of]
    clear = share > CLEAR
    return pairs[clear] >> 16, (pairs[clear] & 0xFFFF) - 1
