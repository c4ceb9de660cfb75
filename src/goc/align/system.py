"""Normal equations of all pairs, and the moves of the cameras that solve them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from goc import _native
from goc.align.images import AlignedView, Samples

_TERMS = 44
"""Numbers of one kind of residual: 36 of the matrix, 6 of the vector, count, sum of sizes."""
_CORRELATED = 20.0
"""Neighbouring points err alike: so many count as one."""
_NEAR, _FAR = 0.3, 0.7
"""Shares of the gaps' size at the typical depth that do not grow with depth, and that grow with its square."""
_COSINE = 0.8
_RELAXED = 1.5
"""Steps go so much further than the equations say: noise of the normals makes these stiffer than the surface is."""
_TOLERANCE = 1e-9
"""Residual of the linear solve, as a share of the right side."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """How a round compares views. Lengths in scene units."""

    blur_px: float
    """Of the photographs."""
    reach: float
    """Larger gaps are of other surfaces."""
    gap: float
    """Standard deviation of gaps at the typical depth."""
    typical: float
    """That depth."""
    channel: int | None = None
    """Of the photographs; None: their mean."""

    @property
    def limits(self) -> Float64[np.ndarray, "4"]:
        """As the kernel takes them."""
        return np.array([_NEAR * self.gap, _FAR * self.gap / self.typical**2, self.reach, _COSINE])


@dataclass(frozen=True, kw_only=True, eq=False)
class PairSums:
    """What each pair of views says."""

    pairs: list[tuple[int, int]]
    """View whose points move, view whose images they are compared with."""
    sums: Float64[np.ndarray, "m k"]
    """A row a pair, as native/register.hpp lays it out, in the axes of the second view."""

    @property
    def counts(self) -> Float64[np.ndarray, "m"]:
        """Points that were compared."""
        return self.sums[:, 42]

    @property
    def mean_gap(self) -> float:
        """Mean size of all gaps, scene units; 0 where nothing was compared."""
        return float(self.sums[:, 43].sum() / max(self.counts.sum(), 1.0))

    @property
    def mean_difference(self) -> float:
        """Mean size of all differences of grey, after gain and offset of each pair; 0 to 1."""
        return float(self.sums[:, _TERMS + 43].sum() / max(self.sums[:, _TERMS + 42].sum(), 1.0))

    @property
    def shades(self) -> Float64[np.ndarray, "m 3"]:
        """Gain and offset that make the first view's photograph the second's, and how many points tell them."""
        return np.stack([self.sums[:, 2 * _TERMS], self.sums[:, 2 * _TERMS + 1], self.sums[:, _TERMS + 42]], -1)


def compare(
    views: Sequence[AlignedView | None],
    samples: Sequence[Samples | None],
    others: Sequence[Sequence[int]],
    poses: Float64[np.ndarray, "v 4 4"],
    look: Look,
) -> PairSums:
    """Compare each view's points with the images of its others."""
    cameras = [None if view is None else view.with_pose(pose) for view, pose in zip(views, poses, strict=True)]
    greys = [None if view is None else view.shade(look.blur_px, look.channel) for view in views]
    pairs, rows, limits = [], [], look.limits
    for index, (own, grey) in enumerate(zip(samples, greys, strict=True)):
        if own is None or grey is None:
            continue
        surface = own.shown_with(grey)
        for other in others[index]:
            target, sums = views[other], np.zeros(_native.REGISTER_SUMS)
            assert target is not None
            images = (target.depth, target.normals, greys[other])
            _native.register_surface(surface, cameras[index], cameras[other], *images, limits, sums)
            pairs.append((index, other))
            rows.append(sums)
    return PairSums(pairs=pairs, sums=np.array(rows).reshape(len(rows), _native.REGISTER_SUMS))


@dataclass(frozen=True, kw_only=True, eq=False)
class Given:
    """What the capture says of its cameras."""

    poses: Float64[np.ndarray, "v 4 4"]
    position: float
    """Standard deviation of positions, scene units."""
    angle: float
    """Standard deviation of directions, radians."""
    fixed: Float64[np.ndarray, "v"]
    """1 for views that do not move, else 0."""


def moved(poses: Float64[np.ndarray, "v 4 4"], found: PairSums, given: Given) -> Float64[np.ndarray, "v 4 4"]:
    """One Gauss-Newton step: cameras that reduce all gaps and differences of grey, held to the given ones.

    Each residual changes with the twist of either view by the same vector, with opposite signs, so that a pair needs
    one 6 by 6 matrix. Twists (turn, shift) are about the middle of the cameras, world axes.
    """
    free = given.fixed == 0
    middle = poses[free, :3, 3].mean(0)
    blocks, right = _prior(poses, given, middle)
    rows, columns, entries = [], [], []
    for (first, second), sums in zip(found.pairs, found.sums, strict=True):
        carry = _twist_in(poses[second], middle)
        both = sums[:_TERMS] + sums[_TERMS : 2 * _TERMS]
        matrix = carry.T @ both[:36].reshape(6, 6) @ carry / _CORRELATED
        vector = carry.T @ both[36:42] / _CORRELATED
        blocks[first] += matrix
        blocks[second] += matrix
        right[first] -= vector
        right[second] += vector
        rows += [first, second]
        columns += [second, first]
        entries += [-matrix, -matrix]
    steps = _RELAXED * _solved(blocks, (rows, columns, entries), np.where(free[:, None], right, 0.0), free)
    turns = Rotation.from_rotvec(steps[:, :3]).as_matrix()
    out = poses.copy()
    out[:, :3, :3] = turns @ poses[:, :3, :3]
    out[:, :3, 3] = np.einsum("vij,vj->vi", turns, poses[:, :3, 3] - middle) + middle + steps[:, 3:]
    out[~free] = poses[~free]
    return out


def _twist_in(
    world_from_cam: Float64[np.ndarray, "4 4"], middle: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "6 6"]:
    """Carries a twist about the middle of the cameras, world axes, to one about a camera, in its axes."""
    turn = world_from_cam[:3, :3].T
    carry = np.zeros((6, 6))
    carry[:3, :3] = carry[3:, 3:] = turn
    carry[3:, :3] = _cross(turn @ (middle - world_from_cam[:3, 3])) @ turn
    return carry


def _prior(
    poses: Float64[np.ndarray, "v 4 4"], given: Given, middle: Float64[np.ndarray, "3"]
) -> tuple[Float64[np.ndarray, "v 6 6"], Float64[np.ndarray, "v 6"]]:
    """Matrices and right sides that hold cameras to the given ones."""
    turned = Rotation.from_matrix(poses[:, :3, :3] @ given.poses[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    apart = np.concatenate([turned, poses[:, :3, 3] - given.poses[:, :3, 3]], 1)
    weights = np.repeat([given.angle**-2.0, given.position**-2.0], 3)
    slopes = np.tile(np.eye(6), (len(poses), 1, 1))
    for slope, pose in zip(slopes, poses, strict=True):
        slope[3:, :3] = -_cross(pose[:3, 3] - middle)
    weighted = slopes.transpose(0, 2, 1) * weights
    return weighted @ slopes, -np.einsum("vij,vj->vi", weighted, apart)


def _cross(v: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3 3"]:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _solved(
    blocks: Float64[np.ndarray, "v 6 6"],
    beside: tuple[list[int], list[int], list[Float64[np.ndarray, "6 6"]]],
    right: Float64[np.ndarray, "v 6"],
    free: np.ndarray,
) -> Float64[np.ndarray, "v 6"]:
    """Conjugate gradients, preconditioned by the blocks: unlike LAPACK, the same bits for any number of threads."""
    rows, columns, entries = beside
    kept = [k for k in range(len(rows)) if free[rows[k]] and free[columns[k]]]
    count = len(blocks)
    index = [np.array([part[k] for k in kept], int) for part in (rows, columns)]
    down, across = np.mgrid[:6, :6]
    data = np.array([entries[k] for k in kept]).reshape(-1, 6, 6)
    place = [(6 * at[:, None, None] + grid).reshape(-1) for at, grid in zip(index, (down, across), strict=True)]
    off = scipy.sparse.csr_array((data.reshape(-1), place), shape=(6 * count, 6 * count))
    inverse = np.linalg.inv(blocks)

    def times(x: Float64[np.ndarray, "v 6"]) -> Float64[np.ndarray, "v 6"]:
        return np.einsum("vij,vj->vi", blocks, x) + (off @ x.reshape(-1)).reshape(-1, 6)

    x, left = np.zeros_like(right), right.copy()
    ready = np.einsum("vij,vj->vi", inverse, left)
    way, energy = ready, (left * ready).sum()
    goal = _TOLERANCE**2 * energy
    for _ in range(10 * 6 * count):
        if energy <= goal:
            break
        image = times(way)
        size = energy / (way * image).sum()
        x, left = x + size * way, left - size * image
        ready = np.einsum("vij,vj->vi", inverse, left)
        before, energy = energy, (left * ready).sum()
        way = ready + energy / before * way
    return x
