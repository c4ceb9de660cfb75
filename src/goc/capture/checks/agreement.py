"""Do views agree through depth? Points of one view are carried into the others and compared with what is stored there.

The share of agreeing points is the best single test of a capture: axes, direction of poses, units, the raster that the
intrinsics belong to, distance instead of z and a lens that is left out all lower it (docs/decisions/0045).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from goc.capture.checks.depth_views import DepthViews

CLOSE = 0.05
"""Relative difference of two depths that agree."""
_LEAST_SHARED = 0.1
"""Share of a view's points that another view must have in its frame, to be compared with it."""
_LEAST_PARALLAX = 0.03
"""Baseline over depth of two views that are compared; without parallax any depth agrees with itself."""
_HIDDEN = 3.0
"""Hidden points for each that is seen, from which on they tell against a capture; few views of a room reach 1.5."""
_PARTNERS = 3
"""Views that each view is compared with: those that have most of its points in their frame."""


@dataclass(frozen=True)
class Agreement:
    """How far views agree through depth."""

    share: float
    """Of the points that another view must see, those whose depth is within 5 % of what it saw; 0 without any.

    A point that lies behind what the other view saw is hidden there, which proves nothing: such points count only
    where they are more than three times as many as all others. One that lies in front of it is a contradiction."""
    fit: float
    """Of all compared points, those that agree: the better to compare units by, which `share` is lenient with."""
    compared: int
    """Points that lie in another view's frame, where that has depth."""
    gap: float
    """Median difference of the two depths where they agree, scene units; NaN without such points."""


@dataclass(frozen=True, eq=False)
class _Counts:
    """Of points of view a (row) in view b (column), each divided by the points of a view."""

    agreeing: Float64[np.ndarray, "v v"]
    before: Float64[np.ndarray, "v v"]
    behind: Float64[np.ndarray, "v v"]
    gaps: Float64[np.ndarray, "v v p"]
    """Difference of the depths that agree, scene units; NaN elsewhere."""
    baseline: Float64[np.ndarray, "v v"]
    """Distance of the cameras over the depth."""

    @property
    def shared(self) -> Float64[np.ndarray, "v v"]:
        return self.agreeing + self.before + self.behind


def agreement(views: DepthViews, close: float = CLOSE, needs_parallax: bool = False) -> Agreement:
    """Compare each view with those that have most of its points in their frame, some parallax given.

    Args:
        views: as they are read.
        close: relative difference of two depths that agree.
        needs_parallax: compare nothing, rather than views without parallax, where there are no others.
    """
    counts = _count(views, close)
    usable = counts.shared >= _LEAST_SHARED
    far = usable & (counts.baseline > _LEAST_PARALLAX)
    chosen = _largest(np.where(far if needs_parallax or far.any() else usable, counts.shared, 0.0), _PARTNERS)
    agreeing, before, behind = (each[chosen].sum() for each in (counts.agreeing, counts.before, counts.behind))
    compared = round(float(agreeing + before + behind) * views.pixels.shape[1])
    if compared == 0:
        return Agreement(0.0, 0.0, 0, float("nan"))
    seen = agreeing + before
    gaps = counts.gaps[chosen]
    gap = float(np.median(gaps[np.isfinite(gaps)])) if agreeing else float("nan")
    share = float(agreeing / (seen + max(0.0, behind - _HIDDEN * seen)))
    return Agreement(share, float(agreeing / (seen + behind)), compared, gap)


def _count(views: DepthViews, limit: float) -> _Counts:
    expected, found = _carried(views)
    ratio = expected / found
    close = np.abs(ratio - 1) < limit
    shares = [each.mean(2) for each in (close, ratio <= 1 - limit, ratio >= 1 + limit)]
    for each in shares:
        np.fill_diagonal(each, 0.0)
    positions = views.poses[:, :3, 3]
    baseline = np.linalg.norm(positions[:, None] - positions[None], axis=-1) / views.typical
    return _Counts(*shares, gaps=np.where(close, np.abs(expected - found), np.nan), baseline=baseline)


def _carried(views: DepthViews) -> tuple[Float64[np.ndarray, "v v p"], Float64[np.ndarray, "v v p"]]:
    """Z of the points of each view (rows) in each other (columns), and the depth that is stored there.

    NaN outside the frame, behind the camera, and where the other view has no depth.
    """
    rotation, position = views.poses[:, :3, :3], views.poses[:, :3, 3]
    local = np.matmul(views.points()[:, None] - position[None, :, None], rotation[None])
    z = np.where(local[..., 2] > 0, local[..., 2], np.nan)
    directions = local[..., :2] / z[..., None]
    if views.radial:
        square = (directions**2).sum(-1, keepdims=True)
        directions = np.where(square < views.fold, directions * (1 + views.radial * square), np.nan)
    pixels = directions * views.focal_px[:, None] + views.centre_px[:, None]
    inside = np.all((pixels >= 0) & (pixels < views.sizes[:, None]), axis=-1)
    at = np.where(inside[..., None], pixels, 0).astype(int)
    found = views.depth[np.arange(len(views))[:, None], at[..., 1], at[..., 0]]
    return z, np.where(inside, found, np.nan).astype(np.float64)


def _largest(scores: Float64[np.ndarray, "v v"], count: int) -> Bool[np.ndarray, "v v"]:
    """Mark the `count` largest scores of each row, those above 0 only."""
    order = np.argsort(-scores, axis=1)[:, :count]
    marked = np.zeros(scores.shape, bool)
    np.put_along_axis(marked, order, True, axis=1)
    return marked & (scores > 0)
