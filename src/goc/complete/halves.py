"""The other half of a scan that ends in a plane: mirrored there, or turned by half a circle, if it then joins."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int64
from scipy.spatial import cKDTree

from goc.complete.copies import Copy
from goc.scene import PointCloud

_TURN_DEG, _FINE_DEG = 2.0, 0.25
"""Steps of the directions in which a cut is looked for at first, and near the best of them."""
_THICK, _SPACINGS = 0.02, 2.5
"""Thickness of the slice of points that lies in a cut: of the longest side, and in spacings of the points at least."""
_OUTERMOST, _JUDGED = 0.998, 20_000
_FACING, _MOST_FACING = 0.6, 0.5
"""Least cosine between a normal and the cut's for a point to face it, and greatest share of the slice that does so: a
cut goes through walls, and leaves the thing open, where a side of a thing closes it."""
_LEAST_FULL = 0.7
"""Least number of points in the slice, in those of a slice of the same thickness if points were spread evenly over the
depth of the scan: at the end of a thing there are few."""
_LEAST_POINTS = 24
_LEAST_DEPTH, _LEAST_WIDTH, _LEAST_HEIGHT = 0.15, 0.12, 0.1
"""Least depth of the scan behind the cut, and width and height of the slice, in longest sides: the straight side of a
plate or a table top looks like a cut, so thin."""
_APART = 0.05
"""Distance, in longest sides, at which a rim and its copy do not meet at all."""
_MOST_MISFIT = 0.5
_NOISE = 0.2
"""Misfit of a right half turn that noise makes, which a mirror image, in place by construction, has not."""
_STEPS = 41


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """An upright plane in which a scan ends: normal·x = offset."""

    normal: Float64[np.ndarray, "3"]
    """Unit, to where nothing was measured."""
    offset: float
    edge: Int64[np.ndarray, "e"]
    """Points that lie in it."""

    def mirrored(self, points: Float[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p 3"]:
        """Where the other half may be."""
        return points - 2.0 * (points @ self.normal - self.offset)[:, None] * self.normal


def find_cut(cloud: PointCloud, up: Float[np.ndarray, "3"]) -> Cut | None:
    """The upright plane in which a scan of half a thing ends; None where it ends in none.

    At a cut as many points lie as in any slice of the scan, in a wide stretch, and hardly any of them faces it: there
    are walls that go on, and no end of a thing (docs/decisions/0047).

    Args:
        cloud: with unit normals outwards.
        up: unit.
    """
    assert cloud.normals is not None
    some = np.random.default_rng(0).permutation(len(cloud.positions))[:_JUDGED]
    points, normals = cloud.positions[some].astype(np.float64), cloud.normals[some].astype(np.float64)
    longest = float(np.ptp(points, axis=0).max())
    thin = _SPACINGS * float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    x = np.eye(3)[int(np.argmin(np.abs(up)))]
    x = x - (x @ up) * up
    axes = np.stack([x / np.linalg.norm(x), np.cross(up, x / np.linalg.norm(x))])

    def full(angle: float, thick: float) -> tuple[float, Cut]:
        way = np.array([np.cos(angle), np.sin(angle)]) @ axes
        height = points @ way
        offset = float(np.quantile(height, _OUTERMOST))
        edge = np.flatnonzero(height > offset - thick)
        facing = float((np.abs(normals[edge] @ way) > _FACING).mean())
        wide = float(np.ptp(np.quantile(points[edge] @ np.cross(way, up), [0.02, 0.98])))
        high = float(np.ptp(np.quantile(points[edge] @ up, [0.02, 0.98])))
        deep = offset - float(height.min())
        share = len(edge) / len(points) * deep / thick
        good = facing <= _MOST_FACING and wide >= _LEAST_WIDTH * longest and deep >= _LEAST_DEPTH * longest
        good = good and high >= _LEAST_HEIGHT * longest and share >= _LEAST_FULL and len(edge) >= _LEAST_POINTS
        return (share * (1 - facing) if good else 0.0), Cut(normal=way, offset=offset, edge=some[edge])

    angles = np.radians(np.arange(0.0, 360.0, _TURN_DEG))
    first = [full(angle, max(thin, _THICK * longest))[0] for angle in angles]
    if not max(first) > 0:
        return None
    near = angles[int(np.argmax(first))] + np.radians(np.arange(-_TURN_DEG, _TURN_DEG + _FINE_DEG / 2, _FINE_DEG))
    return max((full(angle, thin) for angle in near), key=lambda found: len(found[1].edge))[1]


def other_half(cloud: PointCloud, up: Float[np.ndarray, "3"], cut: Cut) -> Copy | None:
    """What makes the missing half of a scan from the half that is there; None where nothing joins it.

    Of the mirror image in the cut and the half turn about an upright axis in it, the one is taken that joins the rim
    better: there the mirror image may have a crease, and the turned one a step.

    Args:
        cloud: with unit normals outwards.
        up: unit.
        cut: where it ends.
    """
    assert cloud.normals is not None
    points, normals = cloud.positions.astype(np.float64), cloud.normals.astype(np.float64)[cut.edge]
    longest = float(np.ptp(points, axis=0).max())
    found = min(
        _mirror(cut.normal, cut.offset, normals),
        _half_turn(cut.normal, cut.offset, up, points[cut.edge], normals, longest),
        key=lambda copy: copy.misfit,
    )
    return found if found.misfit <= _MOST_MISFIT else None


def _mirror(normal: Float64[np.ndarray, "3"], offset: float, rim_normals: Float64[np.ndarray, "e 3"]) -> Copy:
    crease = np.minimum(2 * (rim_normals @ normal) ** 2, 1.0)
    return Copy(
        linear=np.eye(3) - 2 * np.outer(normal, normal),
        shift=2 * offset * normal,
        name="mirror image",
        words="half a thing: the other half is its mirror image",
        misfit=float(crease.mean()),
    )


def _half_turn(
    normal: Float64[np.ndarray, "3"],
    offset: float,
    up: Float[np.ndarray, "3"],
    edge: Float64[np.ndarray, "e 3"],
    rim_normals: Float64[np.ndarray, "e 3"],
    longest: float,
) -> Copy:
    """The half turn about the upright axis in the cut for which the rim meets its own image best."""
    axis = up - (up @ normal) * normal
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, normal)
    linear = 2 * np.outer(axis, axis) - np.eye(3)
    tree = cKDTree(edge)
    place = edge @ across
    middle, reach = (place.min() + place.max()) / 2, np.ptp(place)
    best, least = np.zeros(3), np.inf
    for aside in middle + reach * np.linspace(-0.25, 0.25, _STEPS):
        foot = offset * normal + aside * across
        shift = foot - linear @ foot
        apart, near = tree.query(edge @ linear.T + shift)
        turned = 1 - (rim_normals[near] * (rim_normals @ linear.T)).sum(axis=1)
        misfit = float(np.minimum(apart / (_APART * longest) + turned, 1.0).mean()) - _NOISE
        if misfit < least:
            best, least = shift, misfit
    return Copy(
        linear=linear,
        shift=best,
        name="half turn",
        misfit=max(least, 0.0),
        words="half a thing: the other half is the same, turned round",
    )
