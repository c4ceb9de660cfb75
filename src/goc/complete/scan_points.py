"""The points of a scan made ready: each place once, no outliers, unit normals that look outwards."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from scipy.spatial import cKDTree

from goc.complete.viewpoint import facing, facing_all
from goc.errors import CompleteError
from goc.events import Listener, Warned
from goc.geometry.orientation import point_normals
from goc.scene import PointCloud

_FEWEST, _MOST = 50, 200_000
_NEAREST = 8
_OUTLIER_DISTANCE = 6.0
"""Points whose mean distance to their neighbours is this many times the median are outliers."""


def cleaned(cloud: PointCloud, notify: Listener) -> PointCloud:
    """Points that say something: each place once, outliers left out, 200,000 at most.

    Raises:
        CompleteError: fewer than 50 places, or no extent.
    """
    once = distinct(cloud)
    count = len(once.positions)
    if count < _FEWEST or not np.ptp(once.positions, axis=0).max() > 0:
        given = len(cloud.positions)
        raise CompleteError(f"{given} points tell no surface: {_FEWEST} are needed, in more than one place.")
    kept = without_outliers(once)
    if len(kept.positions) < count:
        message = f"{count - len(kept.positions)} of {count} points lie far from all others: left out."
        notify(Warned(stage="complete", message=message))
    if len(kept.positions) > _MOST:
        kept = chosen(kept, np.random.default_rng(0).permutation(len(kept.positions))[:_MOST])
    return kept


def distinct(cloud: PointCloud) -> PointCloud:
    """Each place once, in the order in which they came: clouds made up to a fixed count repeat points."""
    _, first = np.unique(cloud.positions, axis=0, return_index=True)
    return cloud if len(first) == len(cloud.positions) else chosen(cloud, np.sort(first))


def without_outliers(cloud: PointCloud) -> PointCloud:
    """Drop points that lie far from all others."""
    apart = cKDTree(cloud.positions).query(cloud.positions, k=min(_NEAREST + 1, len(cloud.positions)))[0][:, 1:]
    off = apart.mean(axis=1)
    return chosen(cloud, off <= _OUTLIER_DISTANCE * max(float(np.median(off)), 1e-30))


def typical_spacing(points: Float[np.ndarray, "p 3"]) -> float:
    """Median distance of a point to its nearest neighbour."""
    return float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))


def chosen(cloud: PointCloud, rows: np.ndarray) -> PointCloud:
    """Some points of a cloud."""
    normals = None if cloud.normals is None else cloud.normals[rows]
    return replace(cloud, positions=cloud.positions[rows], colours=cloud.colours[rows], normals=normals)


def given_normals(cloud: PointCloud) -> Float32[np.ndarray, "p 3"] | None:
    """The cloud's own normals, made unit; None where it has none, or has some without direction."""
    if cloud.normals is None:
        return None
    lengths = np.linalg.norm(cloud.normals, axis=1, keepdims=True)
    return (cloud.normals / lengths).astype(np.float32) if (lengths > 0.5).all() else None


def with_normals(cloud: PointCloud, viewpoints: Sequence[Float64[np.ndarray, "3"]]) -> PointCloud:
    """The cloud with unit normals outwards: its own, or estimated ones that look towards the viewpoints.

    Raises:
        CompleteError: its own normals look away from every viewpoint.
    """
    normals = given_normals(cloud)
    if normals is not None:
        if viewpoints:
            _check_sides(normals, cloud.positions, viewpoints)
        return replace(cloud, normals=normals)
    normals = point_normals(cloud.positions)
    if len(viewpoints) == 1:
        normals = facing(normals, cloud.positions, viewpoints[0])
    elif viewpoints:
        normals = facing_all(normals, cloud.positions, viewpoints, typical_spacing(cloud.positions))
    return replace(cloud, normals=normals)


def _check_sides(
    normals: Float32[np.ndarray, "p 3"],
    points: Float32[np.ndarray, "p 3"],
    viewpoints: Sequence[Float64[np.ndarray, "3"]],
) -> None:
    away: Bool[np.ndarray, "p"] = np.all([(normals * (eye - points)).sum(axis=1) < 0 for eye in viewpoints], axis=0)
    if away.mean() > 0.5:
        raise CompleteError(
            f"{away.mean():.0%} of the scan's normals look away from --viewpoint, so it saw the inside. Turn the faces "
            "or normals round, or leave the normals out."
        )
