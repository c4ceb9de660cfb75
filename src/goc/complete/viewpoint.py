"""Marks space as seen empty from the position of one sensor: in front of the points it saw, and beside them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from scipy import ndimage

from goc.errors import CompleteError
from goc.scene import Evidence, EvidenceGrid

_CLEAR = 2.0
"""Space nearer than this many voxels in front of a point is not marked as empty."""
_WIDEST = 4.0
"""Greatest tangent of the angle between the view's axis and a point: beyond, the viewpoint is among the points."""
_CLOSED = 2
"""Pixels, about voxels, by which gaps between points are closed and the outline is widened."""
_SMALL_HOLE = 0.02
"""Holes in the outline below this share of its area are gaps in the scan, not in the object."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _ImagePlane:
    """An image plane at distance 1 before the viewpoint."""

    eye: Float64[np.ndarray, "3"]
    axes: Float64[np.ndarray, "3 3"]
    """Rows: right, down, forward."""
    pixel: float

    def seen_at(self, points: Float[np.ndarray, "p 3"]) -> tuple[Float64[np.ndarray, "p 2"], Float64[np.ndarray, "p"]]:
        """Place in the image plane, in pixels from its axis, and depth; only for depths above 0."""
        local = (points - self.eye) @ self.axes.T
        return local[:, :2] / np.maximum(local[:, 2:], 1e-12) / self.pixel, local[:, 2]


def carve_free_space(
    evidence: EvidenceGrid, points: Float[np.ndarray, "p 3"], viewpoint: Float[np.ndarray, "3"]
) -> EvidenceGrid:
    """Mark unknown space as seen empty that rays from a viewpoint passed on their way to the points or beside them.

    Directions in which no point lies, beyond gaps and small holes, count as seen past the object: a scan is all that
    its sensor saw of the object. What lies behind points stays unknown.

    Raises:
        CompleteError: the viewpoint is among the points.
    """
    view = _looking(viewpoint, points, evidence.voxel)
    at, depth = view.seen_at(points)
    if (depth <= 0).any() or np.abs(at * view.pixel).max() > _WIDEST:
        place = " ".join(f"{value:g}" for value in viewpoint)
        raise CompleteError(
            f"--viewpoint {place}: lies among the points or right beside them. Give the sensor's place, in the "
            "scan's own frame and unit."
        )
    corner = np.floor(at.min(axis=0)).astype(int) - 2 * _CLOSED - 1
    shape = np.floor(at.max(axis=0)).astype(int) + 2 * _CLOSED + 2 - corner
    nearest = np.full(shape, np.inf)
    np.minimum.at(nearest, tuple((np.floor(at).astype(int) - corner).T), depth)
    outline = _outline(np.isfinite(nearest))
    nearest = ndimage.minimum_filter(nearest, 3)
    unknown = np.argwhere(evidence.state == Evidence.UNKNOWN)
    pixels, depths = view.seen_at(evidence.origin + evidence.voxel * unknown)
    rows = np.floor(pixels).astype(int) - corner
    within = ((rows >= 0) & (rows < shape)).all(axis=1)
    rows = tuple(np.clip(rows, 0, shape - 1).T)
    before = np.isfinite(nearest[rows]) & (depths < nearest[rows] - _CLEAR * evidence.voxel)
    passed = (depths > 0) & (~within | ~outline[rows] | before)
    state = evidence.state.copy()
    state[tuple(unknown[passed].T)] = Evidence.EMPTY
    return replace(evidence, state=state)


def facing_all(
    normals: Float32[np.ndarray, "p 3"],
    points: Float[np.ndarray, "p 3"],
    viewpoints: Sequence[Float64[np.ndarray, "3"]],
    voxel: float,
) -> Float32[np.ndarray, "p 3"]:
    """Flip normals that look away from all sensors, or from those that see their point where any does.

    Args:
        normals: unit.
        points: of the scan.
        viewpoints: where sensors stood, none of them among the points.
        voxel: points this near to each other are neighbours.
    """
    votes = np.zeros(len(points))
    for eye in viewpoints:
        view = _looking(eye, points, voxel)
        at, depth = view.seen_at(points)
        rows = np.floor(at / 2).astype(int)  # pixels of two voxels, so that hidden points have others before them
        rows -= rows.min(axis=0)
        nearest = np.full(rows.max(axis=0) + 1, np.inf)
        np.minimum.at(nearest, tuple(rows.T), depth)
        seen = depth < nearest[tuple(rows.T)] + 2 * _CLEAR * voxel
        towards = eye - points
        votes += seen * (normals * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    return np.where((votes < 0)[:, None], -normals, normals).astype(np.float32)


def facing(
    normals: Float32[np.ndarray, "p 3"], points: Float[np.ndarray, "p 3"], viewpoint: Float[np.ndarray, "3"]
) -> Float32[np.ndarray, "p 3"]:
    """Flip normals that look away from the sensor."""
    away = (normals * (viewpoint - points)).sum(axis=1) < 0
    return np.where(away[:, None], -normals, normals).astype(np.float32)


def _looking(viewpoint: Float[np.ndarray, "3"], points: Float[np.ndarray, "p 3"], voxel: float) -> _ImagePlane:
    eye = np.asarray(viewpoint, np.float64)
    towards = (points.min(axis=0) + points.max(axis=0)) / 2.0 - eye
    away = max(float(np.linalg.norm(towards)), 1e-12)
    forward = towards / away
    aside = np.eye(3)[int(np.argmin(np.abs(forward)))]
    right = np.cross(forward, aside)
    right /= max(float(np.linalg.norm(right)), 1e-12)
    return _ImagePlane(eye=eye, axes=np.stack([right, np.cross(forward, right), forward]), pixel=voxel / away)


def _outline(hit: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels that the object covers or may cover: gaps closed, small holes filled, widened at the border."""
    closed = ndimage.binary_closing(hit, iterations=_CLOSED)
    holes, count = ndimage.label(~closed)
    sizes = np.bincount(holes.ravel(), minlength=count + 1)
    small = sizes < _SMALL_HOLE * closed.sum()
    small[holes[0, 0]] = False  # the outside
    small[0] = True  # what is closed already
    return ndimage.binary_dilation(small[holes])
