"""Volumes of closed meshes: volume, IoU, and how far meshes penetrate each other and the walls."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64

from goc.evaluation.metrics import SurfaceSamples
from goc.geometry.raycast import TriangleScene
from goc.geometry.topology import is_closed, signed_volume, watertight_flaw
from goc.scene import Mesh

IOU_CELLS = 64
"""Cells along each axis of the box that IoU and sampled volumes are counted in, one random point a cell: 262,144."""
OVERLAP_CELLS = 40
"""The same for the volume that two objects share, in the box that both reach into: 64,000."""

Box = tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """A mesh with its scene, flaws, box and volume, each computed once when first needed."""

    mesh: Mesh

    @cached_property
    def scene(self) -> TriangleScene:
        """The mesh for ray casting, distances and winding numbers."""
        return TriangleScene(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def flaw(self) -> str | None:
        """What keeps it from being watertight."""
        return watertight_flaw(self.mesh)

    @cached_property
    def self_intersections(self) -> int:
        """Pairs of triangles that cut each other."""
        return int(self.scene.crossings().sum()) // 2

    @cached_property
    def has_inside(self) -> bool:
        """It has no border and is not turned inside out."""
        return self.flaw is None or (is_closed(self.mesh) and signed_volume(self.mesh) > 0)

    @cached_property
    def box(self) -> Box:
        """Least and greatest corner."""
        used = self.mesh.vertices[np.unique(self.mesh.faces)].astype(np.float64)
        return used.min(axis=0), used.max(axis=0)

    @cached_property
    def volume(self) -> float:
        """What it encloses, overlapping parts once: exact where no triangles cut each other, else counted.

        Only where it has an inside.
        """
        if self.self_intersections == 0:
            return signed_volume(self.mesh)
        points, size = _points_in(self.box, IOU_CELLS, seed=0)
        return float(self.holds(points).mean()) * size

    def holds(self, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Which points are inside: the surface winds round them."""
        inside = np.zeros(len(points), bool)
        low, high = self.box
        near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
        inside[near] = self.scene.winding(points[near]) > 0
        return inside


@dataclass(frozen=True, eq=False)
class RoomWalls:
    """A closed room: either a shell that faces inwards, or solid walls that face outwards."""

    mesh: Mesh

    @cached_property
    def scene(self) -> TriangleScene:
        """The walls for distances and winding numbers."""
        return TriangleScene(self.mesh.vertices, self.mesh.faces)

    def hold(self, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Which points are in a wall: not in the free space."""
        free = -1 if signed_volume(self.mesh) < 0 else 0
        return self.scene.winding(points) != free


@dataclass(frozen=True, kw_only=True)
class Penetration:
    """How far two objects penetrate each other."""

    depth: float
    """Of the surface samples of either inside the other, the greatest distance to the other's surface; 0: none is."""
    volume: float
    """Shared, cubed units."""


NO_PENETRATION = Penetration(depth=0.0, volume=0.0)


def intersection_over_union(first: SolidMesh, second: SolidMesh, seed: int) -> float:
    """Volume in both over volume in either, by one random point in each of 64³ cells of their common box."""
    low, high = np.minimum(first.box[0], second.box[0]), np.maximum(first.box[1], second.box[1])
    points, _ = _points_in((low, high), IOU_CELLS, seed)
    a, b = first.holds(points), second.holds(points)
    return float((a & b).sum() / max(1, (a | b).sum()))


def penetration(
    first: SolidMesh, samples: SurfaceSamples, second: SolidMesh, second_samples: SurfaceSamples, seed: int
) -> Penetration:
    """How far two closed meshes penetrate each other; both must have an inside."""
    low, high = np.maximum(first.box[0], second.box[0]), np.minimum(first.box[1], second.box[1])
    if not (low < high).all():
        return NO_PENETRATION
    depth = max(_depth(samples.points, second), _depth(second_samples.points, first))
    points, size = _points_in((low, high), OVERLAP_CELLS, seed)
    return Penetration(depth=depth, volume=float((first.holds(points) & second.holds(points)).mean()) * size)


def wall_depth(samples: SurfaceSamples, walls: RoomWalls) -> float:
    """How deep a surface reaches into the walls; works for open surfaces too."""
    inside = samples.points[walls.hold(samples.points)]
    return float(walls.scene.nearest(inside)[0].max(initial=0.0))


def wall_volume(solid: SolidMesh, walls: RoomWalls, seed: int) -> float:
    """How much of a solid is in the walls."""
    points, size = _points_in(solid.box, OVERLAP_CELLS, seed)
    points = points[solid.holds(points)]
    return float(walls.hold(points).sum()) / OVERLAP_CELLS**3 * size


def _depth(points: Float64[np.ndarray, "n 3"], solid: SolidMesh) -> float:
    inside = points[solid.holds(points)]
    return float(solid.scene.nearest(inside)[0].max(initial=0.0))


def _points_in(box: Box, cells: int, seed: int) -> tuple[Float64[np.ndarray, "n 3"], float]:
    """One random point in each of cells³ equal cells, and the volume of the box."""
    low, high = box
    grid = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    points = (grid + np.random.default_rng([seed, cells]).random(grid.shape)) / cells
    return low + points * (high - low), float(np.prod(high - low))
