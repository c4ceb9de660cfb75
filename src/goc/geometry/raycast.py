"""Ray casting and distance queries against triangles: hits, occlusion, winding numbers, nearest points, crossings."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32

from goc._native import TriangleBvh

_ASKEW = np.array([0.2770466965, 0.4896321036, 0.8267439332])
"""A direction with irrational ratios, which no lattice has: from a point of one, no ray meets an edge of what is
modelled on it, where both its faces would count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RayHits:
    """The nearest hit of each of n rays."""

    t: Float64[np.ndarray, "n"]
    """Distance in lengths of the ray's direction; infinity where nothing was hit."""
    triangle: Int32[np.ndarray, "n"]
    """Index of the triangle; -1 where nothing was hit."""
    barycentrics: Float64[np.ndarray, "n 3"]
    """Weights of the triangle's corners, sum 1; 0 where nothing was hit."""

    @property
    def found(self) -> Bool[np.ndarray, "n"]:
        """Which rays hit something."""
        return self.triangle >= 0


@dataclass(frozen=True, eq=False)
class TriangleScene:
    """A triangle soup that rays can be cast at; the hierarchy is built once, when the scene is made.

    Both sides of a triangle are hit. Rays do not slip through shared edges: the test is watertight (Woop et al. 2013).
    Results are the same for any number of threads.

    Raises:
        ValueError: no faces, a vertex that is not finite, or a face that names a vertex that is not there.
    """

    vertices: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "t 3"]
    _bvh: TriangleBvh = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.faces) == 0:
            raise ValueError("TriangleScene: no faces, so nothing can be hit.")
        bad = np.flatnonzero(~np.isfinite(self.vertices).all(-1))
        if len(bad):
            raise ValueError(f"TriangleScene: {len(bad)} vertices are not finite (first: {bad[0]}).")
        outside = np.flatnonzero(((self.faces < 0) | (self.faces >= len(self.vertices))).any(-1))
        if len(outside):
            raise ValueError(
                f"TriangleScene: {len(outside)} faces name vertices outside 0…{len(self.vertices) - 1} "
                f"(first: face {outside[0]})."
            )
        bvh = TriangleBvh(np.ascontiguousarray(self.vertices), np.ascontiguousarray(self.faces))
        object.__setattr__(self, "_bvh", bvh)

    def closest_hit(self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> RayHits:
        """The nearest triangle in front of each ray's origin (t > 0).

        Args:
            origins: scene frame, finite.
            directions: scene frame, of any length but zero; t counts in this length, so that directions with z = 1 in
                camera axes give the depth along the optical axis.
        """
        origins, directions = _rays(origins, directions)
        hits = RayHits(
            t=np.zeros(len(origins)),
            triangle=np.zeros(len(origins), np.int32),
            barycentrics=np.zeros((len(origins), 3)),
        )
        self._bvh.closest_hit(origins, directions, hits.t, hits.triangle, hits.barycentrics)
        return hits

    def occluded(
        self,
        origins: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        max_distance: Float[np.ndarray, "n"] | float,
    ) -> Bool[np.ndarray, "n"]:
        """Whether each ray hits anything with 0 < t < max_distance, t in lengths of its direction."""
        origins, directions = _rays(origins, directions)
        limits = np.ascontiguousarray(np.broadcast_to(np.asarray(max_distance, np.float64), (len(origins),)))
        if np.isnan(limits).any():
            raise ValueError("occluded: a maximal distance is NaN.")
        blocked = np.zeros(len(origins), bool)
        self._bvh.occluded(origins, directions, limits, blocked)
        return blocked

    def winding(self, points: Float[np.ndarray, "n 3"]) -> Int32[np.ndarray, "n"]:
        """How often the surface winds round each point: 1 inside an ordinary solid, 0 outside, -1 inside a room.

        Means something only for a surface without a border (`goc.geometry.topology.is_closed`); points on the surface
        itself may fall to either side.
        """
        points = _finite_points(points)
        numbers = np.zeros(len(points), np.int32)
        self._bvh.winding(points, _ASKEW, numbers)
        return numbers

    def nearest(
        self, points: Float[np.ndarray, "n 3"], limit: Float[np.ndarray, "n"] | float = np.inf
    ) -> tuple[Float64[np.ndarray, "n"], Int32[np.ndarray, "n"]]:
        """Distance from each point to the surface, and the triangle it is nearest to.

        Beyond `limit` they are infinite and -1; a small limit makes the search quick.
        """
        points = _finite_points(points)
        limits = np.ascontiguousarray(np.broadcast_to(np.asarray(limit, np.float64), (len(points),)))
        if not (limits >= 0).all():
            raise ValueError("nearest: a limit is negative or NaN.")
        distances, triangles = np.zeros(len(points)), np.zeros(len(points), np.int32)
        self._bvh.nearest(points, limits, distances, triangles)
        return distances, triangles

    def crossings(self, asked: Bool[np.ndarray, "t"] | None = None) -> Int32[np.ndarray, "t"]:
        """How many other triangles each triangle cuts; the sum is twice the number of intersecting pairs.

        Only triangles `asked` for are counted, the others get 0.

        Two triangles cut each other where they share a segment of positive length and are not coplanar (Möller 1997).
        Touching, in a common edge, a corner or otherwise, is not cutting.
        """
        counts = np.zeros(len(self.faces), np.int32)
        self._bvh.crossings(np.ones(len(counts), bool) if asked is None else asked, counts)
        return counts


def _finite_points(points: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    points = np.ascontiguousarray(points, np.float64)
    if not np.isfinite(points).all():
        raise ValueError("Distances and sides need finite points.")
    return points


def _rays(
    origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
    origins, directions = np.ascontiguousarray(origins, np.float64), np.ascontiguousarray(directions, np.float64)
    squares = np.einsum("ij,ij->i", directions, directions)
    if not (np.isfinite(origins).all() and np.isfinite(squares).all()):
        raise ValueError("Rays need finite origins and directions.")
    if not (squares > 1e-60).all():
        raise ValueError("Rays need directions of non-zero length.")
    return origins, directions
