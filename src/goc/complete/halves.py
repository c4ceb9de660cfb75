"""The other half of a scan that ends in a plane: mirrored there, or turned by half a circle, if it then joins."""

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy.spatial import cKDTree

from goc.complete.copies import Copy
from goc.scene import PointCloud

_NEIGHBOURS = 20
_GAP = 2.0
"""Angle, in radians, without neighbours from which on a point is on the rim."""
_TRIALS = 300
_TOLERANCE = 2.5
"""Distance from a cut, in spacings of the points, up to which a point of the rim lies in it."""
_LEAST_RIM, _LEAST_POINTS = 0.4, 24
"""Share of the rim that lies in the cut, and number of points of it."""
_MOST_BEYOND = 0.01
"""Greatest share of points beyond the cut."""
_LEAST_DEPTH, _LEAST_WIDTH = 0.15, 0.15
"""Least depth of the scan behind the cut, and spread of the rim in it, in longest sides."""
_UPRIGHT = 0.5
"""Greatest sine between a cut and up: what ends in a level plane stood on something, or is open above."""
_APART = 0.05
"""Distance, in longest sides, at which a rim and its copy do not meet at all."""
_MOST_MISFIT = 0.4
_NOISE = 0.2
"""Misfit of a right half turn that noise makes, which a mirror image, in place by construction, has not."""
_STEPS = 41


def other_half(cloud: PointCloud, up: Float[np.ndarray, "3"]) -> Copy | None:
    """What makes the missing half of a scan from the half that is there; None where it does not end in a plane.

    Where a scan's rim lies in one upright plane with all points on one side, the thing was cut in its middle, as far as
    anyone can tell. Of the mirror image in that plane and the half turn about an upright axis in it, the one is taken
    that joins the rim better: there the mirror image may have a crease, and the turned one a step.

    Args:
        cloud: with unit normals outwards.
        up: unit.
    """
    points = cloud.positions.astype(np.float64)
    assert cloud.normals is not None
    normals = cloud.normals.astype(np.float64)
    spacing = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    on_rim = rim(points, normals)
    cut = _cut(points, on_rim, up, spacing)
    if cut is None:
        return None
    normal, offset = cut
    edge = np.flatnonzero(on_rim & (np.abs(points @ normal - offset) < _TOLERANCE * spacing))
    longest = float(np.ptp(points, axis=0).max())
    found = min(
        _mirror(normal, offset, normals[edge]),
        _half_turn(normal, offset, up, points[edge], normals[edge], longest),
        key=lambda copy: copy.misfit,
    )
    return found if found.misfit <= _MOST_MISFIT else None


def rim(points: Float64[np.ndarray, "p 3"], normals: Float64[np.ndarray, "p 3"]) -> Bool[np.ndarray, "p"]:
    """Points at which a surface ends: round them, in their tangent plane, a wide angle holds no neighbour."""
    near = cKDTree(points).query(points, k=min(_NEIGHBOURS + 1, len(points)))[1][:, 1:]
    aside = np.eye(3)[np.abs(normals).argmin(axis=1)]
    right = np.cross(normals, aside)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-12)
    down = np.cross(normals, right)
    way = points[near] - points[:, None]
    angle = np.sort(np.arctan2((way * down[:, None]).sum(-1), (way * right[:, None]).sum(-1)), axis=1)
    gaps = np.diff(np.concatenate([angle, angle[:, :1] + 2 * np.pi], axis=1), axis=1)
    return gaps.max(axis=1) > _GAP


def _cut(
    points: Float64[np.ndarray, "p 3"], on_rim: Bool[np.ndarray, "p"], up: Float[np.ndarray, "3"], spacing: float
) -> tuple[Float64[np.ndarray, "3"], float] | None:
    """The upright plane that holds most of the rim and leaves no points beyond: unit normal outwards, offset."""
    edge = points[on_rim]
    if len(edge) < _LEAST_POINTS:
        return None
    random = np.random.default_rng(0)
    corners = edge[random.integers(0, len(edge), (_TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1)
    normals = normals[size > 0] / size[size > 0, None]
    offsets = (normals * corners[size > 0, 0]).sum(axis=1)
    side = np.where(normals @ points.mean(axis=0) > offsets, -1.0, 1.0)
    normals, offsets = normals * side[:, None], offsets * side
    held = (np.abs(edge @ normals.T - offsets) < _TOLERANCE * spacing).sum(axis=0)
    beyond = (points @ normals.T - offsets > _TOLERANCE * spacing).mean(axis=0)
    held = np.where((np.abs(normals @ up) <= _UPRIGHT) & (beyond <= _MOST_BEYOND), held, 0)
    best = int(held.argmax()) if len(held) else 0
    if not len(held) or held[best] < max(_LEAST_RIM * len(edge), _LEAST_POINTS):
        return None
    return _refined(points, edge, normals[best], float(offsets[best]), spacing)


def _refined(
    points: Float64[np.ndarray, "p 3"],
    edge: Float64[np.ndarray, "e 3"],
    normal: Float64[np.ndarray, "3"],
    offset: float,
    spacing: float,
) -> tuple[Float64[np.ndarray, "3"], float] | None:
    """The plane fitted to its own part of the rim; None where the scan is flat against it, or the rim is a line."""
    for _ in range(3):
        own = edge[np.abs(edge @ normal - offset) < _TOLERANCE * spacing]
        middle = own.mean(axis=0)
        spreads, axes = np.linalg.eigh(np.cov((own - middle).T))
        normal = axes[:, 0] * np.sign(axes[:, 0] @ normal)
        offset = float(normal @ middle)
    longest = float(np.ptp(points, axis=0).max())
    offset = float(np.quantile(points @ normal, 0.998))
    deep = offset - float((points @ normal).min())
    wide = float(np.ptp((own - middle) @ axes[:, 1]))
    return (normal, offset) if deep > _LEAST_DEPTH * longest and wide > _LEAST_WIDTH * longest else None


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
