"""Signed distance of any mesh on a grid: exact where the mesh is closed, else with the sign that views give."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32
from scipy.spatial import cKDTree

from goc.extract.depth import DepthView
from goc.extract.volume import BLOCK, Lattice, Volume
from goc.geometry.raycast import TriangleScene
from goc.scene import Mesh
from goc.training.solids import BAND, Solid
from goc.training.surroundings import nothing_round
from goc.training.viewpoints import Viewpoint, random_viewpoints

_SAMPLES = 80_000
_CANDIDATES = 4
"""Triangles that the distance of a grid point is taken to: those of its nearest samples."""
_CROSSINGS = 64
"""Most crossings followed along a column: a mesh with more is not a thing."""
_SHEET = 0.6
"""Half the thickness that single sheets and thinner walls are given, voxels: less would fall through the grid."""

@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """Points of a grid round a mesh in the frame of a Solid."""

    origin: Float64[np.ndarray, "3"]
    voxel: float
    shape: tuple[int, int, int]

    def lines(self) -> list[Float64[np.ndarray, "_"]]:
        """Coordinates along each axis."""
        return [self.origin[axis] + self.voxel * np.arange(self.shape[axis]) for axis in range(3)]

    def points(self, chosen: Bool[np.ndarray, "x y z"]) -> Float64[np.ndarray, "p 3"]:
        """Positions of the chosen points."""
        return self.origin + self.voxel * np.argwhere(chosen)


def standing(mesh: Mesh) -> Mesh:
    """The mesh in the frame of a Solid: longest side 1, on z = 0, its box centred over the origin.

    Raises:
        ValueError: no extent.
    """
    low, high = mesh.vertices.min(0).astype(np.float64), mesh.vertices.max(0).astype(np.float64)
    longest = float((high - low).max())
    if not longest > 0:
        raise ValueError("all vertices are in one place")
    foot = np.array([*(low + high)[:2] / 2, low[2]])
    return Mesh(vertices=((mesh.vertices - foot) / longest).astype(np.float32), faces=mesh.faces)


def is_closed(faces: Int32[np.ndarray, "t 3"]) -> bool:
    """Every edge is on exactly two faces, which pass it in opposite directions (docs/decisions: watertight)."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    span = int(faces.max()) + 1
    forth, back = ends[:, 0] * span + ends[:, 1], ends[:, 1] * span + ends[:, 0]
    forth.sort()
    back.sort()
    return bool((np.diff(forth) > 0).all() and (forth == back).all())


def volume_of(mesh: Mesh) -> float:
    """Signed volume of a closed mesh."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def solid_of(mesh: Mesh, cells: int) -> tuple[Solid, str]:
    """Signed distance of a welded mesh, and how its sign was found: "closed" or "carved".

    closed: winding numbers along three axes, two of three agree; overlapping closed pieces unite. carved: inside is
    what none of 60 virtual views sees through. Sheets, and walls thinner than a voxel, get a thickness of 1.2 voxels.

    Raises:
        ValueError: nothing is inside, or the mesh has no extent.
    """
    mesh = standing(mesh)
    voxel = 1.0 / cells
    rim = BAND + 1
    low, high = mesh.vertices.min(0) - rim * voxel, mesh.vertices.max(0) + rim * voxel
    shape = np.ceil((high - low) / voxel).astype(int) + 1
    grid = Grid(origin=low.astype(np.float64), voxel=voxel, shape=tuple(int(n) for n in shape))
    scene = TriangleScene(mesh.vertices, mesh.faces)
    closed = is_closed(mesh.faces) and abs(volume_of(mesh)) > 1e-6
    samples, face = _dense_samples(mesh)
    tree = cKDTree(samples)
    if closed:
        inside = inside_by_winding(scene, grid)
    else:
        inside = _inside_by_views(scene, mesh, grid)
    distance = _signed(mesh, tree, face, grid, inside)
    thin = _is_thin(scene, mesh, samples, face, grid, inside)
    distance = np.minimum(distance, _thickened(mesh, samples[thin], face[thin], grid))
    if (distance < 0).sum() < 64:
        raise ValueError("nothing is inside: no closed shape")
    return Solid(distance=distance, origin=grid.origin, voxel=voxel), "closed" if closed else "carved"


def inside_by_winding(scene: TriangleScene, grid: Grid) -> Bool[np.ndarray, "x y z"]:
    """Grid points with a winding number other than 0, by the crossings along each axis; two of three axes decide."""
    votes = np.zeros(grid.shape, np.int8)
    corners = scene.vertices[scene.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for axis in range(3):
        votes += _winding(scene, normals[:, axis], grid, axis) != 0
    return votes >= 2


def _winding(scene: TriangleScene, facing: Float[np.ndarray, "t"], grid: Grid, axis: int) -> Int[np.ndarray, "x y z"]:
    """Winding number of each grid point, from the faces crossed on the way to it along one axis."""
    lines = grid.lines()
    others = [other for other in range(3) if other != axis]
    starts = np.zeros((grid.shape[others[0]], grid.shape[others[1]], 3))
    starts[..., others[0]] = lines[others[0]][:, None]
    starts[..., others[1]] = lines[others[1]]
    starts = starts.reshape(-1, 3)
    starts[:, axis] = lines[axis][0] - grid.voxel
    direction = np.eye(3)[axis]
    changes = np.zeros((len(starts), grid.shape[axis] + 1), np.int32)
    rows = np.arange(len(starts))
    for _ in range(_CROSSINGS):
        hits = scene.closest_hit(starts[rows], np.broadcast_to(direction, (len(rows), 3)))
        rows, t, triangle = rows[hits.found], hits.t[hits.found], hits.triangle[hits.found]
        if len(rows) == 0:
            break
        at = starts[rows, axis] + t
        place = np.clip(np.ceil((at - lines[axis][0]) / grid.voxel), 0, grid.shape[axis]).astype(int)
        np.add.at(changes, (rows, place), -np.sign(facing[triangle]).astype(np.int32))
        starts[rows, axis] = at + 1e-6
    winding = changes[:, :-1].cumsum(1).reshape(grid.shape[others[0]], grid.shape[others[1]], grid.shape[axis])
    return np.moveaxis(winding, -1, axis)


def _inside_by_views(scene: TriangleScene, mesh: Mesh, grid: Grid) -> Bool[np.ndarray, "x y z"]:
    """Grid points that no ray of 60 virtual views passes: the fusion of real captures, with views all round."""
    random = np.random.default_rng(0)
    box = (mesh.vertices.min(0).astype(np.float64), mesh.vertices.max(0).astype(np.float64))
    blocks = -(-np.array(grid.shape) // BLOCK)
    table = np.stack(np.meshgrid(*(np.arange(n) for n in blocks), indexing="ij"), -1).reshape(-1, 3)
    lattice = Lattice(origin=grid.origin, voxel=grid.voxel, truncation=0.5 * grid.voxel, blocks=table.astype(np.int32))
    volume = Volume(lattice)
    for viewpoint in random_viewpoints(box, nothing_round(), "round", 60, 200, random):
        volume.add(_depth_of(scene, viewpoint), wanted=None)
    before = (volume.weight > 0) & (volume.distance() > 0)  # in the band, on the near side
    passed = ((volume.empty > 0) | before).reshape(*blocks, BLOCK, BLOCK, BLOCK).transpose(0, 3, 1, 4, 2, 5)
    nx, ny, nz = grid.shape
    return ~passed.reshape(blocks * BLOCK)[:nx, :ny, :nz]


def _depth_of(scene: TriangleScene, at: Viewpoint) -> DepthView:
    origins, directions = at.rays()
    depth = scene.closest_hit(origins, directions).t
    depth = np.where(np.isfinite(depth), depth, 1e3).astype(np.float32).reshape(at.size, at.size)
    return DepthView(
        depth=depth,
        slope=np.ones_like(depth),
        ids=None,
        colours=np.zeros((*depth.shape, 3), np.uint8),
        pinhole=at.pinhole(),
        world_from_cam=at.world_from_cam[:3],
    )


def _is_thin(
    scene: TriangleScene,
    mesh: Mesh,
    samples: Float64[np.ndarray, "p 3"],
    face: Int[np.ndarray, "p"],
    grid: Grid,
    inside: Bool[np.ndarray, "x y z"],
) -> Bool[np.ndarray, "p"]:
    """Samples of sheets, with air on both sides, and of walls whose other side is nearer than the grid can hold."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[face]
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    sheet, wall = np.ones(len(samples), bool), np.zeros(len(samples), bool)
    step = 1e-4 * grid.voxel
    for way in (-1.0, 1.0):
        side = way * normals
        within = _any_corner(inside, (samples + 1.5 * grid.voxel * side - grid.origin) / grid.voxel)
        sheet &= ~within
        safe = np.where(np.abs(side).max(-1, keepdims=True) > 0, side, [[0.0, 0.0, 1.0]])
        across = scene.closest_hit(samples + step * safe, safe).t
        middle = samples + 0.5 * np.minimum(across, 1e3)[:, None] * side
        wall |= (across < 2 * _SHEET * grid.voxel) & _any_corner(inside, (middle - grid.origin) / grid.voxel)
    return sheet | wall


def _any_corner(inside: Bool[np.ndarray, "x y z"], at: Float64[np.ndarray, "p 3"]) -> Bool[np.ndarray, "p"]:
    """Whether any of the eight grid points round each place is inside."""
    low = np.clip(np.floor(at), 0, np.array(inside.shape) - 2).astype(int)
    found = np.zeros(len(at), bool)
    for corner in np.ndindex(2, 2, 2):
        found |= inside[tuple((low + corner).T)]
    return found


def _thickened(
    mesh: Mesh, samples: Float64[np.ndarray, "p 3"], face: Int[np.ndarray, "p"], grid: Grid
) -> Float32[np.ndarray, "x y z"]:
    """Distance to the surface of thin things, given their least thickness; the cut-off value where there are none."""
    limit = np.float32(BAND * grid.voxel)
    if len(samples) == 0:
        return np.full(grid.shape, limit)
    distance = _unsigned(mesh, cKDTree(samples), face, grid)
    return np.where(distance < limit, distance - np.float32(_SHEET * grid.voxel), limit)


def _signed(
    mesh: Mesh, tree: cKDTree, face: Int[np.ndarray, "p"], grid: Grid, inside: Bool[np.ndarray, "x y z"]
) -> Float32[np.ndarray, "x y z"]:
    distance = _unsigned(mesh, tree, face, grid)
    return np.where(inside, -distance, distance)


def _unsigned(mesh: Mesh, tree: cKDTree, face: Int[np.ndarray, "p"], grid: Grid) -> Float32[np.ndarray, "x y z"]:
    """Distance to the mesh, cut off at the band: exact to the triangles of the nearest samples."""
    limit = BAND * grid.voxel
    field = np.full(grid.shape, np.float32(limit))
    near = np.zeros(grid.shape, bool)
    index = np.rint((tree.data - grid.origin) / grid.voxel).astype(int)
    reach = int(BAND) + 1
    near[tuple(np.clip(index, 0, np.array(grid.shape) - 1).T)] = True
    for axis in range(3):  # a box filter of the occupied cells, axis by axis
        grown = near.copy()
        for step in range(1, reach + 1):
            ahead, behind = [slice(None)] * 3, [slice(None)] * 3
            ahead[axis], behind[axis] = slice(step, None), slice(None, -step)
            grown[tuple(ahead)] |= near[tuple(behind)]
            grown[tuple(behind)] |= near[tuple(ahead)]
        near = grown
    points = grid.points(near)
    best = np.full(len(points), limit)
    for start in range(0, len(points), 65_536):
        part = slice(start, start + 65_536)
        _, rows = tree.query(points[part], k=_CANDIDATES)
        for column in range(_CANDIDATES):
            rows_here = np.minimum(rows[:, column], len(face) - 1)
            corners = mesh.vertices[mesh.faces[face[rows_here]]].astype(np.float64)
            best[part] = np.minimum(best[part], point_triangle_distance(points[part], corners))
    field[near] = best
    return field


def point_triangle_distance(
    points: Float64[np.ndarray, "p 3"], corners: Float64[np.ndarray, "p 3 3"]
) -> Float64[np.ndarray, "p"]:
    """Distance of each point to its triangle: to the plane where the foot is inside, else to the nearest edge."""
    a = corners[:, 0]
    u, v, w = corners[:, 1] - a, corners[:, 2] - a, points - a
    uu, uv, vv = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    wu, wv = (w * u).sum(-1), (w * v).sum(-1)
    area = np.maximum(uu * vv - uv * uv, 1e-30)
    s, t = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    foot = a + s[:, None] * u + t[:, None] * v
    over = (s >= 0) & (t >= 0) & (s + t <= 1) & (area > 1e-30)
    nearest = np.where(over, np.linalg.norm(points - foot, axis=-1), np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        along, rest = corners[:, j] - corners[:, i], points - corners[:, i]
        share = np.clip((rest * along).sum(-1) / np.maximum((along * along).sum(-1), 1e-30), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(rest - share[:, None] * along, axis=-1))
    return nearest


def _dense_samples(mesh: Mesh) -> tuple[Float64[np.ndarray, "p 3"], Int[np.ndarray, "p"]]:
    """Area-uniform samples of a mesh and the face of each; every face has its middle at least."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1)
    if not areas.sum() > 0:
        raise ValueError("the mesh has no area")
    random = np.random.default_rng(0)
    face = np.concatenate([random.choice(len(corners), _SAMPLES, p=areas / areas.sum()), np.arange(len(corners))])
    root, share = np.sqrt(random.random((len(face), 1))), random.random((len(face), 1))
    root[_SAMPLES:], share[_SAMPLES:] = 2 / 3, 0.5
    a, b, c = corners[face].transpose(1, 0, 2)
    return (1 - root) * a + root * (1 - share) * b + root * share * c, face
