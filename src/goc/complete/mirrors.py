"""Mirror planes of a measured surface: what one half shows of an object tells of the other, where no ray disagrees.

After Mitra et al. 2006 (partial symmetries by votes and refinement) and Thrun and Wegbreit 2005 (symmetries scored
against what rays saw): a plane counts for as much as the measured surface mirrored in it meets measured surface
again, and for nothing where the image lies in space that rays passed.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from scipy import ndimage
from scipy.spatial import cKDTree

from goc.scene import Evidence, EvidenceGrid

Z_UP = np.array([0.0, 0.0, 1.0])

_POINTS, _SCAN_POINTS = 800, 160
"""Measured points that a plane is judged by, and that the first search looks at."""
_TURNS, _STEPS = 30, 31
"""Directions of upright planes, and places along each, at which the first search looks."""
_SPHERE = 160
"""Directions of planes where up is not known."""
_TRIED = 8
"""Planes of the first search that are refined."""
_NEAR = 0.08
"""Points nearer to a plane than this share of the longest side say little about it: they are their own image."""
_AGREE = 0.4
"""Least cosine between a mirrored normal and the normals of the surface that its point meets."""
_CELL = 4
"""Voxels along the side of a cell whose normals are averaged."""
_COST = 4.0
"""How many points that meet measured surface outweigh a point whose image rays passed."""
_LEAST_SUPPORT, _MOST_CONTRADICTION = 0.25, 0.06
"""A plane needs this share of the measured surface in its favour, and may have at most this share against it."""
_TOLD = 0.2
"""What a plane is worth that tells nothing new, beside the share of the surface that another tells something of."""
_APART_DEG, _APART = 15.0, 0.1
"""Planes nearer to each other than this in angle and, in longest sides, in place are one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MirrorPlane:
    """A plane normal·x = offset in which an object seems to mirror itself; the frame of its evidence."""

    normal: Float64[np.ndarray, "3"]
    """Unit."""
    offset: float
    support: float
    """Share of the measured surface whose image lies on measured surface; what is near the plane counts less. [0, 1]"""
    contradiction: float
    """Share whose image lies in space that rays passed. [0, 1]"""
    gain: float = 0.0
    """Share whose image lies where nothing is known: what the plane has to tell. [0, 1]"""

    @property
    def score(self) -> float:
        """How far the plane can be trusted, [0, 1]: of what can be checked, what agrees, if that is enough."""
        checked = self.support + _COST * self.contradiction
        return self.support / checked * min(1.0, self.support / (2 * _LEAST_SUPPORT)) if checked > 0 else 0.0

    def image(self, points: Float[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p 3"]:
        """The points' mirror images."""
        return points - 2.0 * (points @ self.normal - self.offset)[:, None] * self.normal


def mirror_planes(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    evidence: EvidenceGrid,
    up: Float[np.ndarray, "3"] | None = Z_UP,
    most: int = 2,
) -> tuple[MirrorPlane, ...]:
    """Planes in which a measured surface can be mirrored without what rays saw disagreeing.

    Those come first that can be trusted and tell most: things that are turned mirror themselves in many.

    Args:
        points: on the measured surface, the frame of the evidence.
        normals: unit, outwards; zero where unknown.
        evidence: what is known of the box round them.
        up: only planes that contain it are looked for, which are those of nearly all things; None: any plane.
        most: planes to give at most.

    Returns:
        None where the surface that is seen twice is too small to tell: absence of contradiction is no evidence.
    """
    if len(points) < 30:
        return ()
    judge = _judge(points, normals, evidence)
    found: list[MirrorPlane] = []
    for plane in _candidates(judge, up):
        plane = _refined(judge, plane, up)
        good = plane.support >= _LEAST_SUPPORT and plane.contradiction <= _MOST_CONTRADICTION
        if good and not any(_same(plane, other, judge.longest) for other in found):
            found.append(plane)
    return tuple(sorted(found, key=lambda plane: -plane.score * (_TOLD + plane.gain))[:most])


def mirrored_evidence(evidence: EvidenceGrid, plane: MirrorPlane) -> EvidenceGrid:
    """The evidence with unknown voxels as their mirror images are: measured surface, seen empty, or still unknown."""
    place = np.argwhere(evidence.state == Evidence.UNKNOWN)
    images = (plane.image(evidence.origin + evidence.voxel * place) - evidence.origin) / evidence.voxel
    nearest = np.rint(images).astype(np.int64)
    inside = ((nearest >= 0) & (nearest < evidence.state.shape)).all(axis=1)
    place, images, nearest = place[inside], images[inside], nearest[inside]
    found = evidence.state[tuple(nearest.T)]
    state, sdf = evidence.state.copy(), evidence.sdf.copy()
    state[tuple(place.T)] = found
    on = found == Evidence.SURFACE
    measured = (evidence.state == Evidence.SURFACE).astype(np.float32)
    share, total = (
        ndimage.map_coordinates(field, images[on].T, order=1) for field in (measured, measured * evidence.sdf)
    )
    sdf[tuple(place[on].T)] = total / np.maximum(share, 1e-3)  # of the eight voxels around, those that were measured
    return replace(evidence, state=state, sdf=sdf)


def surface_points(
    evidence: EvidenceGrid, most: int = 1500
) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p 3"]]:
    """Points on the measured surface and unit normals outwards, read off the evidence; frame of the evidence."""
    near = np.argwhere((evidence.state == Evidence.SURFACE) & (np.abs(evidence.sdf) < 0.6 * evidence.voxel))
    if len(near) > most:
        near = near[np.random.default_rng(0).choice(len(near), most, replace=False)]
    top = np.array(evidence.state.shape) - 1
    slope = np.zeros((len(near), 3))
    here = tuple(near.T)
    for axis in range(3):
        for way in (-1, 1):
            there = near.copy()
            there[:, axis] = np.clip(near[:, axis] + way, 0, top[axis])
            place = tuple(there.T)
            step = evidence.sdf[place] - evidence.sdf[here]
            slope[:, axis] += np.where(evidence.state[place] == Evidence.SURFACE, way * step, 0.0)
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    normals = slope / np.maximum(length, 1e-12)
    points = evidence.origin + evidence.voxel * near
    return points - evidence.sdf[here][:, None] * normals, normals


@dataclass(frozen=True, kw_only=True, eq=False)
class _Judge:
    """Measured points, and what can be looked up at the images of them."""

    points: Float64[np.ndarray, "p 3"]
    normals: Float64[np.ndarray, "p 3"]
    tree: cKDTree
    evidence: EvidenceGrid
    facing: Float32[np.ndarray, "i j k 3"]
    """Mean normals of cells of `_CELL`³ voxels."""
    passed: Bool[np.ndarray, "i j k"]
    """Cells that rays passed everywhere: voxels beside a surface are seen empty or not by the noise of its depth."""
    tolerance: float
    """Distance from measured surface at which an image does not lie on it any more."""
    longest: float


def _judge(points: Float[np.ndarray, "p 3"], normals: Float[np.ndarray, "p 3"], evidence: EvidenceGrid) -> _Judge:
    cells = (np.array(evidence.state.shape) - 1) // _CELL + 1
    at = np.clip(np.rint((points - evidence.origin) / evidence.voxel).astype(np.int64) // _CELL, 0, cells - 1)
    flat = np.ravel_multi_index(tuple(at.T), tuple(cells))
    count = np.maximum(np.bincount(flat, minlength=cells.prod()), 1)
    facing = [np.bincount(flat, normals[:, axis], minlength=cells.prod()) / count for axis in range(3)]
    chosen = np.random.default_rng(0).permutation(len(points))[:_POINTS]
    kept = points[chosen].astype(np.float64)
    longest = float(np.ptp(points, axis=0).max())
    return _Judge(
        points=kept,
        normals=normals[chosen].astype(np.float64),
        tree=cKDTree(kept),
        evidence=evidence,
        facing=np.stack(facing, -1).reshape(*cells, 3).astype(np.float32),
        passed=_passed(evidence),
        tolerance=max(0.03 * longest, 1.5 * evidence.voxel),
        longest=longest,
    )


def _passed(evidence: EvidenceGrid) -> Bool[np.ndarray, "i j k"]:
    empty = evidence.state == Evidence.EMPTY
    for axis in range(3):
        empty = np.logical_and.reduceat(empty, np.arange(0, empty.shape[axis], _CELL), axis=axis)
    return empty


def _tally(
    judge: _Judge, normals: Float64[np.ndarray, "m 3"], offsets: Float64[np.ndarray, "m"], count: int
) -> Float64[np.ndarray, "3 m"]:
    """Support, contradiction and gain of m planes, judged by the first `count` points."""
    points, own, grid = judge.points[:count], judge.normals[:count], judge.evidence
    above = points @ normals.T - offsets  # p m
    flat = np.zeros(above.shape, np.int32)
    cell = np.zeros(above.shape, np.int32)
    inside = np.ones(above.shape, bool)
    start = (points - grid.origin) / grid.voxel
    for axis, length in enumerate(grid.state.shape):
        at = np.rint(start[:, axis, None] - above * (2.0 / grid.voxel * normals[:, axis])).astype(np.int32)
        inside &= (at >= 0) & (at < length)
        np.clip(at, 0, length - 1, out=at)
        flat = flat * length + at
        cell = cell * judge.facing.shape[axis] + at // _CELL
    state = np.where(inside, grid.state.ravel()[flat], np.uint8(Evidence.UNKNOWN))
    p, m = np.nonzero(state == Evidence.SURFACE)
    there = judge.facing.reshape(-1, 3)[cell[p, m]]
    turned = (there * own[p]).sum(axis=1) - 2.0 * (own @ normals.T)[p, m] * (there * normals[m]).sum(axis=1)
    agrees = turned >= _AGREE * np.linalg.norm(there, axis=1) * np.linalg.norm(own, axis=1)[p]
    on = np.maximum(0.0, 1.0 - np.abs(grid.sdf.ravel()[flat[p, m]]) / judge.tolerance) * agrees
    weight = np.minimum(1.0, np.abs(above) / (_NEAR * judge.longest))
    total = np.maximum(weight.sum(axis=0), 0.2 * len(points))
    support = np.bincount(m, weight[p, m] * on, minlength=len(normals)) / total
    against, unknown = judge.passed.ravel()[cell] & inside, state == Evidence.UNKNOWN
    return np.stack([support, *((weight * field).sum(axis=0) / total for field in (against, unknown))])


def _candidates(judge: _Judge, up: Float[np.ndarray, "3"] | None) -> list[MirrorPlane]:
    """The best planes of a coarse search over directions and places, no two of them alike."""
    directions = _spread_directions() if up is None else _upright_directions(up)
    reach = judge.points @ directions.T
    low, high = reach.min(axis=0), reach.max(axis=0)
    share = np.linspace(0.06, 0.94, _STEPS)
    offsets = (low + share[:, None] * (high - low)).T.ravel()
    normals = np.repeat(directions, _STEPS, axis=0)
    votes = _tally(judge, normals, offsets, _SCAN_POINTS)
    support = votes[0]
    worth = support - votes[1] + _TOLD * votes[2]  # what is slightly off has some against it that is not meant
    found: list[MirrorPlane] = []
    for best in np.argsort(-worth):
        if len(found) == _TRIED or support[best] < 0.5 * _LEAST_SUPPORT:
            break
        plane = _voted(normals[best], offsets[best], votes[:, best])
        if not any(_same(plane, other, judge.longest) for other in found):
            found.append(plane)
    return found


def _refined(judge: _Judge, plane: MirrorPlane, up: Float[np.ndarray, "3"] | None) -> MirrorPlane:
    """The plane moved to where most surface meets its image: by trial, then by fitting, if that is any better."""
    middle = judge.points.mean(axis=0)
    best = plane
    for step in (1.0, 0.4):
        best = _best_nearby(judge, best, up, middle, step)
    return _fitted(judge, best, up)


def _best_nearby(
    judge: _Judge, plane: MirrorPlane, up: Float[np.ndarray, "3"] | None, middle: Float64[np.ndarray, "3"], step: float
) -> MirrorPlane:
    """The best of the planes a little turned and shifted; the turn is about `up`, or about two axes without it."""
    axes = [np.cross(plane.normal, up)] if up is not None else list(_across(plane.normal))
    turns = np.deg2rad(step * np.array([-3.0, -1.5, 0.0, 1.5, 3.0]))
    ways = np.stack(np.meshgrid(*[turns] * len(axes), indexing="ij"), -1).reshape(-1, len(axes)) @ np.stack(axes)
    normals = plane.normal + ways
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shifts = step * 0.015 * judge.longest * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    away = plane.offset - plane.normal @ middle
    offsets = (normals @ middle)[:, None] + away + shifts
    normals = np.repeat(normals, len(shifts), axis=0)
    votes = _tally(judge, normals, offsets.ravel(), _POINTS // 2)
    best = int(np.argmax(votes[0] - _COST * votes[1]))
    return _voted(normals[best], offsets.ravel()[best], votes[:, best])


def _fitted(judge: _Judge, plane: MirrorPlane, up: Float[np.ndarray, "3"] | None, rounds: int = 3) -> MirrorPlane:
    """Gauss-Newton on the distances of images from the tangents of the surface nearest to them (Chen, Medioni 1991)."""
    axes = np.stack([np.cross(plane.normal, up)] if up is not None else _across(plane.normal))
    points, normals = judge.points[: _POINTS // 2], judge.normals[: _POINTS // 2]
    normal, offset = plane.normal, plane.offset
    for _ in range(rounds):
        above = points @ normal - offset
        images = points - 2.0 * above[:, None] * normal
        away, nearest = judge.tree.query(images, distance_upper_bound=2.0 * judge.tolerance)
        met = np.isfinite(away)
        tangents = judge.normals[np.minimum(nearest, len(judge.points) - 1)]
        turned = normals - 2.0 * (normals @ normal)[:, None] * normal
        met &= (turned * tangents).sum(axis=1) > _AGREE
        if met.sum() < 20:
            break
        image, tangent, height, point = images[met], tangents[met], above[met], points[met]
        misses = ((image - judge.points[nearest[met]]) * tangent).sum(axis=1)
        slopes = [-2.0 * ((point @ axis) * (tangent @ normal) + height * (tangent @ axis)) for axis in axes]
        slopes = np.stack([*slopes, 2.0 * (tangent @ normal)], axis=1)
        weight = 1.0 / (1.0 + (misses / (0.5 * judge.tolerance)) ** 2)
        stiff = np.diag([judge.longest**2] * len(axes) + [1.0]) * 0.05 * met.sum()
        change = np.linalg.solve(slopes.T @ (weight[:, None] * slopes) + stiff, -slopes.T @ (weight * misses))
        normal = normal + change[:-1] @ axes
        length = float(np.linalg.norm(normal))
        normal, offset = normal / length, (offset + float(change[-1])) / length
    votes = _tally(judge, np.stack([normal, plane.normal]), np.array([offset, plane.offset]), _POINTS)
    return max(_voted(normal, offset, votes[:, 0]), _voted(plane.normal, plane.offset, votes[:, 1]), key=_worth)


def _voted(normal: Float64[np.ndarray, "3"], offset: float, votes: Float64[np.ndarray, "3"]) -> MirrorPlane:
    support, against, unknown = (float(vote) for vote in votes)
    return MirrorPlane(normal=normal, offset=float(offset), support=support, contradiction=against, gain=unknown)


def _worth(plane: MirrorPlane) -> float:
    return plane.support - _COST * plane.contradiction


def _same(plane: MirrorPlane, other: MirrorPlane, longest: float) -> bool:
    cosine = float(plane.normal @ other.normal)
    if abs(cosine) < np.cos(np.deg2rad(_APART_DEG)):
        return False
    return abs(plane.offset - float(np.sign(cosine)) * other.offset) < _APART * longest


def _across(normal: Float64[np.ndarray, "3"]) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    """Two directions at right angles to a normal and to each other."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def _upright_directions(up: Float[np.ndarray, "3"]) -> Float64[np.ndarray, "m 3"]:
    first, second = _across(up / np.linalg.norm(up))
    angles = np.arange(_TURNS)[:, None] * np.pi / _TURNS
    return np.cos(angles) * first + np.sin(angles) * second


def _spread_directions() -> Float64[np.ndarray, "m 3"]:
    """Directions spread evenly over half a sphere, on a spiral (Vogel 1979)."""
    height = (np.arange(_SPHERE) + 0.5) / _SPHERE
    angle = np.arange(_SPHERE) * np.pi * (3.0 - np.sqrt(5.0))
    ring = np.sqrt(1.0 - height**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
