"""Finds where a bare scan was seen from: the sensor met every ray's first surface, and met all directions evenly."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy import ndimage
from scipy.spatial import cKDTree

from goc.geometry.orientation import point_normals

_PIXEL = 2.0
"""Side of the pixels in which depths are compared, in spacings of the points at the middle of the scan."""
_NEIGHBOURS, _FAR = 6, 0.7
"""Neighbour whose distance tells the density at a point, and greatest deviation of its logarithm that counts: at an
outline neighbours are far."""
_SPACING = 1.6
"""Side of the square that a point covers, in distances to its nearest neighbour (random points: 2; a raster: 1)."""
_LAYER = 0.04
"""Points this far behind all that lies before them, in longest sides, are hidden."""
_NEAREST, _FURTHEST = 0.3, 30.0
"""Least and greatest distance of a viewpoint from the box of the points, in longest sides."""
_HIDDEN = 0.05
"""Greatest share of points that are hidden from the viewpoint: silhouettes and noise."""
_UNEVEN, _UNEVEN_ORIGIN = 0.16, 0.4
"""Greatest spread of the distances over what a sensor saw; a frame's origin is a likely place, any other is not."""
_DIRECTIONS, _DISTANCE, _ROUNDS = 200, 3.0, 3
_FACING = 0.95
"""Least share of a scan's own normals that look towards its viewpoint."""
_ALIKE = 1.25
"""Two opposite places whose spreads differ by less than this factor cannot be told apart by density."""
_LEVEL = 0.2
"""Sine of the elevation from which on a viewpoint is above or below."""
_WIDEST = 4.0
_MOST, _JUDGES = 60_000, 2000
"""Points that are looked at, and those of them at which the density is: thinned out, a raster is none any more."""


@dataclass(frozen=True, kw_only=True)
class Sight:
    """How the points look from one place."""

    hidden: float
    """Share of the points that lie behind others."""
    spread: float
    """Spread of the logarithm of the distance between neighbours in the image; 0: evenly dense. Infinite if more are
    hidden than may be: then nobody asks."""


def sight_from(points: Float[np.ndarray, "p 3"], eye: Float[np.ndarray, "3"], spacing: float) -> Sight | None:
    """How points look from a place; None from among them, or from beside them.

    Args:
        points: a scan, any frame.
        eye: in the same frame.
        spacing: distance of neighbouring points.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float((high - low).max())
    beyond = float(np.linalg.norm(np.maximum(np.maximum(low - eye, eye - high), 0.0)))
    if not _NEAREST * longest <= beyond <= _FURTHEST * longest:
        return None
    forward = (low + high) / 2 - eye
    away = float(np.linalg.norm(forward))
    right = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(forward)))])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward / away, right), forward / away])
    local = (points - eye) @ axes.T
    depth = local[:, 2]
    if (depth <= 0.1 * away).any():
        return None
    at = local[:, :2] / depth[:, None]
    if np.abs(at).max() > _WIDEST:
        return None
    hidden = _hidden(at / (_PIXEL * spacing / away), depth, _LAYER * longest)
    return Sight(hidden=hidden, spread=np.inf if hidden > 2 * _HIDDEN else _density_spread(at))


def find_viewpoint(
    points: Float[np.ndarray, "p 3"], normals: Float[np.ndarray, "p 3"] | None, up: Float[np.ndarray, "3"] | None
) -> tuple[Float64[np.ndarray, "3"], str] | None:
    """The one place that a scan was seen from, and how it was found; None if there is none.

    A depth image meets each ray's first surface only, so from its sensor no point lies behind another; and its pixels
    meet all directions alike, so that the points are evenly dense as seen from there, and from nowhere else. The
    origin of the scan's frame is tried first, then places all round. Points that were thinned out evenly over the
    surface, or that several views made, have no such place.

    Args:
        points: a scan, outliers and duplicates removed.
        normals: unit, outwards, if the scan has its own: all of them look to where it was seen from.
        up: unit; tells from which of two sides a scan was seen whose density leaves it open. None: unknown.

    Returns:
        The place, and `origin` or `density`.
    """
    rows = np.random.default_rng(0).permutation(len(points))[:_MOST]
    judges = points[rows].astype(np.float64)
    own = None if normals is None else normals[rows].astype(np.float64)
    spacing = _SPACING * float(np.median(cKDTree(judges).query(judges, k=2)[0][:, 1]))
    origin = sight_from(judges, np.zeros(3), spacing)
    if origin is not None and origin.hidden <= _HIDDEN and _face(own, judges, np.zeros(3)):
        if own is not None or origin.spread <= _UNEVEN_ORIGIN:
            return np.zeros(3), "origin"
    found = _searched(judges, up, spacing)
    return None if found is None or not _face(own, judges, found) else (found, "density")


def _face(
    normals: Float64[np.ndarray, "p 3"] | None, points: Float64[np.ndarray, "p 3"], eye: Float64[np.ndarray, "3"]
) -> bool:
    return normals is None or float(((normals * (eye - points)).sum(axis=1) > 0).mean()) >= _FACING


def stands_apart(points: Float[np.ndarray, "p 3"], eye: Float[np.ndarray, "3"]) -> bool:
    """Whether points can have been seen from a place: it is away from them, and few of them hide behind others."""
    spacing = _SPACING * float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    sight = sight_from(points.astype(np.float64), eye, spacing)
    return sight is not None and sight.hidden <= 2 * _HIDDEN


def _searched(
    points: Float64[np.ndarray, "p 3"], up: Float[np.ndarray, "3"] | None, spacing: float
) -> Float64[np.ndarray, "3"] | None:
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    distance = _DISTANCE * float(np.ptp(points, axis=0).max())
    best, least = None, np.inf
    tried = _directions(_DIRECTIONS)
    for width in 0.12 * 0.5 ** np.arange(_ROUNDS + 1):
        for direction in tried:
            spread = _spread(sight_from(points, middle + distance * direction, spacing))
            if spread < least:
                best, least = direction, spread
        if best is None:
            return None
        tried = best + width * _directions(16)
        tried /= np.linalg.norm(tried, axis=1, keepdims=True)
    if best is None or least > _UNEVEN:
        return None
    if _spread(sight_from(points, middle - distance * best, spacing)) < _ALIKE * least:
        best = _likelier(points, best, up)
    return middle + distance * best


def _spread(sight: Sight | None) -> float:
    if sight is None or sight.hidden > _HIDDEN:
        return np.inf
    return sight.spread


def _likelier(
    points: Float64[np.ndarray, "p 3"], direction: Float64[np.ndarray, "3"], up: Float[np.ndarray, "3"] | None
) -> Float64[np.ndarray, "3"]:
    """From far away a bowl looks as a dome does from the other side: the higher place, or else that of the dome."""
    if up is not None and abs(float(direction @ up)) > _LEVEL:
        return direction if float(direction @ up) > 0 else -direction
    return direction if float((point_normals(points) @ direction).mean()) >= 0 else -direction


def _hidden(at: Float64[np.ndarray, "p 2"], depth: Float64[np.ndarray, "p"], layer: float) -> float:
    """Share of points that lie behind the nearest ones of their own pixel and of all its neighbours."""
    rows = np.floor(at).astype(int)
    rows -= rows.min(axis=0) - 1
    nearest = np.full(rows.max(axis=0) + 2, np.inf)
    np.minimum.at(nearest, tuple(rows.T), depth)
    front = ndimage.maximum_filter(np.where(np.isfinite(nearest), nearest, -np.inf), 3)
    return float((depth > front[tuple(rows.T)] + layer).mean())


def _density_spread(at: Float64[np.ndarray, "p 2"]) -> float:
    """Spread of the logarithms of the distances to a near neighbour."""
    judges = at[:: max(1, len(at) // _JUDGES)]
    apart = np.log(np.maximum(cKDTree(at).query(judges, k=_NEIGHBOURS + 1)[0][:, -1], 1e-12))
    return float(np.sqrt((np.clip(apart - np.median(apart), -_FAR, _FAR) ** 2).mean()))


def _directions(count: int) -> Float64[np.ndarray, "{count} 3"]:
    """Unit vectors all round, evenly spread (Fibonacci's spiral)."""
    number = np.arange(count) + 0.5
    height, turn = 1 - 2 * number / count, np.pi * (1 + np.sqrt(5)) * number
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), height], -1)
