"""Converts any mesh to a watertight shape: the sign is exact if it is closed, else it comes from virtual views."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32

from goc.evaluation.metrics import SurfaceSamples, sample_surface
from goc.fusion.depth_views import DepthView
from goc.fusion.volume import BLOCK, BlockGrid, Volume
from goc.geometry.raycast import TriangleScene
from goc.geometry.rays import world_rays
from goc.geometry.topology import is_closed, signed_volume
from goc.scene import Camera, Mesh
from goc.training.surroundings import no_surroundings
from goc.training.viewpoints import random_viewpoints
from goc.training.watertight_shape import BAND, WatertightShape

_VIEWS, _VIEW_PX = 60, 200
_SAMPLES = 60_000
"""Number of surface samples at which the thickness of a mesh is measured."""
_HALF_SHEET = 0.6
"""Half the thickness, in voxels, to which sheets and thin walls are thickened, since a grid cannot hold less."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """Points of a grid around a mesh, in the frame of a WatertightShape."""

    origin: Float64[np.ndarray, "3"]
    voxel: float
    shape: tuple[int, int, int]

    def points(self) -> Float64[np.ndarray, "p 3"]:
        """Positions of all points, with the last axis fastest."""
        return self.origin + self.voxel * np.stack(np.unravel_index(np.arange(np.prod(self.shape)), self.shape), -1)


def in_shape_frame(mesh: Mesh) -> Mesh:
    """Move a mesh to the frame of a WatertightShape: longest side 1, on z = 0, its box centred over the origin.

    Raises:
        ValueError: all vertices are in one place.
    """
    low, high = mesh.vertices.min(0).astype(np.float64), mesh.vertices.max(0).astype(np.float64)
    longest = float((high - low).max())
    if not longest > 0:
        raise ValueError("all vertices are in one place")
    foot = np.array([*(low + high)[:2] / 2, low[2]])
    return Mesh(vertices=((mesh.vertices - foot) / longest).astype(np.float32), faces=mesh.faces)


def shape_from_mesh(mesh: Mesh, cells: int) -> tuple[WatertightShape, str]:
    """Compute the signed distance of a welded mesh, and tell how its sign was found: "closed" or "carved".

    closed: inside is where the winding number is not 0, so that overlapping closed pieces unite. carved: inside is
    where none of 60 virtual views sees through. Sheets and thin walls get a thickness of 1.2 voxels.

    Args:
        mesh: in any unit and at any place, z up.
        cells: number of voxels along its longest side.

    Raises:
        ValueError: nothing is inside, or the mesh has no extent or no area.
    """
    mesh = in_shape_frame(mesh)
    voxel = 1.0 / cells
    rim = BAND + 1
    low, high = mesh.vertices.min(0).astype(np.float64) - rim * voxel, mesh.vertices.max(0) + rim * voxel
    shape = tuple(int(n) for n in np.ceil((high - low) / voxel) + 1)
    grid = Grid(origin=low, voxel=voxel, shape=shape)
    scene = TriangleScene(mesh.vertices, mesh.faces)
    closed = is_closed(mesh) and abs(signed_volume(mesh)) > 1e-6
    points = grid.points()
    if closed:
        inside = (scene.winding(points) != 0).reshape(shape)
    else:
        inside = _inside_by_views(scene, mesh, grid)
    distance = _distance(scene, points, grid)
    distance = np.where(inside, -distance, distance)
    thin = _thin_faces(scene, sample_surface(mesh, _SAMPLES), inside, grid, closed)
    if len(thin):
        thickened = _distance(TriangleScene(mesh.vertices, mesh.faces[thin]), points, grid)
        reached = thickened < np.float32(BAND * voxel)
        distance = np.where(reached, np.minimum(distance, thickened - np.float32(_HALF_SHEET * voxel)), distance)
    if (distance < 0).sum() < 64:
        raise ValueError("nothing is inside: no closed shape")
    return WatertightShape(distance=distance, origin=grid.origin, voxel=voxel), "closed" if closed else "carved"


def _distance(scene: TriangleScene, points: Float64[np.ndarray, "p 3"], grid: Grid) -> Float32[np.ndarray, "x y z"]:
    """Distance from the grid points to the surface, at most the band."""
    limit = BAND * grid.voxel
    found, _ = scene.nearest(points, limit)
    return np.minimum(found, limit).astype(np.float32).reshape(grid.shape)


def _inside_by_views(scene: TriangleScene, mesh: Mesh, grid: Grid) -> Bool[np.ndarray, "x y z"]:
    """Grid points that no ray of 60 virtual views passes, by the same fusion as for real captures."""
    random = np.random.default_rng(0)
    box = (mesh.vertices.min(0).astype(np.float64), mesh.vertices.max(0).astype(np.float64))
    blocks = -(-np.array(grid.shape) // BLOCK)
    table = np.stack(np.meshgrid(*(np.arange(n) for n in blocks), indexing="ij"), -1).reshape(-1, 3)
    block_grid = BlockGrid(
        origin=grid.origin, voxel=grid.voxel, truncation=0.5 * grid.voxel, blocks=table.astype(np.int32)
    )
    volume = Volume(block_grid)
    for viewpoint in random_viewpoints(box, no_surroundings(), "sphere", _VIEWS, _VIEW_PX, random):
        volume.add(_depth_of(scene, viewpoint), wanted=None)
    before = (volume.weight > 0) & (volume.distance() > 0)  # in the band, on the near side
    passed = ((volume.empty > 0) | before).reshape(*blocks, BLOCK, BLOCK, BLOCK).transpose(0, 3, 1, 4, 2, 5)
    nx, ny, nz = grid.shape
    return ~passed.reshape(blocks * BLOCK)[:nx, :ny, :nz]


def _depth_of(scene: TriangleScene, at: Camera) -> DepthView:
    origins, directions = world_rays(at)
    depth = scene.closest_hit(origins, directions).t
    depth = np.where(np.isfinite(depth), depth, 1e3).astype(np.float32).reshape(at.height, at.width)
    return DepthView(
        depth=depth,
        slope=np.ones_like(depth),
        ids=None,
        colours=None,
        camera=at,
    )


def _thin_faces(
    scene: TriangleScene, samples: SurfaceSamples, inside: Bool[np.ndarray, "x y z"], grid: Grid, closed: bool
) -> Int32[np.ndarray, "_"]:
    """Indices of the faces of sheets, with air on both sides, and of walls too thin for the grid."""
    sheet, wall = np.ones(len(samples), bool), np.zeros(len(samples), bool)
    for way in (-1.0, 1.0):
        side = way * samples.normals
        beside = samples.points + 1.5 * grid.voxel * side
        sheet &= ~_any_corner(inside, (beside - grid.origin) / grid.voxel)
        across = scene.closest_hit(samples.points + 1e-4 * grid.voxel * side, side).t
        middle = samples.points + 0.5 * np.minimum(across, grid.voxel)[:, None] * side
        near = across < 2 * _HALF_SHEET * grid.voxel
        if closed:  # in an open mesh, a narrow gap of air cannot be told from a wall
            near[near] = scene.winding(middle[near]) != 0
        wall |= near
    _, face = scene.nearest(samples.points[sheet | wall], grid.voxel)
    return np.unique(face[face >= 0])


def _any_corner(inside: Bool[np.ndarray, "x y z"], at: Float64[np.ndarray, "p 3"]) -> Bool[np.ndarray, "p"]:
    """Whether any of the eight grid points around each place, in voxels, is inside."""
    low = np.clip(np.floor(at), 0, np.array(inside.shape) - 2).astype(int)
    found = np.zeros(len(at), bool)
    for corner in np.ndindex(2, 2, 2):
        found |= inside[tuple((low + corner).T)]
    return found
