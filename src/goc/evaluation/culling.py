"""Removes the parts of a mesh that training views did not see, as published protocols do: fused renders, frustums."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64, Int32

from goc.fusion.depth_views import DepthView
from goc.fusion.volume import BlockGrid, Volume, blocks_near, zero_level
from goc.geometry.raycast import TriangleScene
from goc.geometry.rays import world_rays
from goc.geometry.voxels import cells_of, pack_cells, unpack_cells
from goc.scene import Camera, Mesh

_CHUNK_BLOCKS = 8_192
"""Blocks fused at a time: 134 MB."""
_CELL_VOXELS = 4
"""Edge of the cells in which surface is looked for, voxels."""
_LAYERS = 16
"""Greatest number of back faces in a row that a ray passes through."""


@dataclass(frozen=True, kw_only=True)
class RefusionConfig:
    """Settings of PhyRecon's ScanNet evaluation (Open3D's ScalableTSDFVolume there)."""

    voxel: float = 0.01
    truncation: float = 0.03
    depth_limit: float = 5.0
    """Pixels with greater depth are not fused, metres."""


def fuse_renders(mesh: Mesh, cameras: tuple[Camera, ...], settings: RefusionConfig) -> Mesh:
    """Fuse depth renders of a mesh from all cameras: the part that they saw, evenly tessellated.

    Back faces are not rendered. Depth is z; each pixel speaks for the signed distance along its ray.

    Returns:
        An open mesh, empty where no camera saw anything.
    """
    model = _Model(mesh)
    views = [view for camera in cameras if (view := _rendered(model, camera, settings.depth_limit)) is not None]
    size = _CELL_VOXELS * settings.voxel
    keys = [np.unique(pack_cells(cells_of(_points(view), size))) for view in views]
    seen = unpack_cells(np.unique(np.concatenate([np.zeros(0, np.int64), *keys]))).astype(np.int32)
    grid = BlockGrid(
        origin=np.zeros(3),
        voxel=settings.voxel,
        truncation=settings.truncation,
        blocks=blocks_near(seen, size, np.zeros(3), settings.voxel, settings.truncation),
    )
    vertices, faces = zero_level(grid, _fused(grid, views))
    return Mesh(vertices=vertices, faces=faces)


def cull_to_frustums(mesh: Mesh, cameras: tuple[Camera, ...]) -> Mesh:
    """Keep the faces with a corner inside some camera's image; occlusion is not tested."""
    vertices = mesh.vertices.astype(np.float64)
    inside = np.zeros(len(vertices), bool)
    for camera in cameras:
        inside |= _in_image(vertices, camera)
    return Mesh(vertices=mesh.vertices, faces=mesh.faces[inside[mesh.faces].any(axis=1)])


class _Model:
    """A mesh with a scene, face normals and bounding box for rendering it."""

    def __init__(self, mesh: Mesh) -> None:
        corners = mesh.vertices.astype(np.float64)[mesh.faces]
        self.scene = TriangleScene(mesh.vertices, mesh.faces)
        self.normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self.box = np.array([[(low, high)[n >> axis & 1][axis] for axis in range(3)] for n in range(8)])
        """Its eight corners."""


def _fused(grid: BlockGrid, views: list[DepthView]) -> Float32[np.ndarray, "b 8 8 8"]:
    distances = [np.zeros((0, 8, 8, 8), np.float32)]
    for start in range(0, len(grid.blocks), _CHUNK_BLOCKS):
        part = grid.blocks[start : start + _CHUNK_BLOCKS]
        volume = Volume(BlockGrid(origin=grid.origin, voxel=grid.voxel, truncation=grid.truncation, blocks=part))
        for view in views:
            volume.add(view, wanted=None)
        # Rays that pass in front of the band vote for the full truncation, as Open3D has it.
        seen, passed = volume.weight, volume.empty
        total = np.maximum(seen + passed, np.float32(1e-20))
        distances.append((volume.distance() * seen + np.float32(grid.truncation) * passed) / total)
    return np.concatenate(distances)


def _rendered(model: _Model, camera: Camera, depth_limit: float) -> DepthView | None:
    """Z of the nearest front face in each pixel; None where the mesh is out of sight."""
    depth = np.full(camera.height * camera.width, np.nan, np.float32)
    pixels = _pixels_of(model.box, camera)
    row, column = np.divmod(pixels, camera.width)
    z = _front_hits(model, *world_rays(camera, np.stack([column, row], axis=1) + 0.5))
    depth[pixels] = np.where(z <= depth_limit, z, np.nan)
    if not (z <= depth_limit).any():
        return None
    shape = (camera.height, camera.width)
    return DepthView(
        depth=depth.reshape(shape),
        slope=np.ones(shape, np.float32),
        ids=None,
        colours=None,
        camera=camera,
    )


def _front_hits(
    model: _Model, origins: Float64[np.ndarray, "n 3"], rays: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n"]:
    """Distance in lengths of the ray to the first face that faces its origin, infinite where there is none."""
    found = np.full(len(rays), np.inf)
    left = np.arange(len(rays))
    passed = np.zeros(len(rays))
    for _ in range(_LAYERS):
        hits = model.scene.closest_hit(origins[left] + passed[left, None] * rays[left], rays[left])
        passed[left] += hits.t
        behind = np.einsum("ij,ij->i", model.normals[hits.triangle], rays[left]) > 0
        found[left[~behind]] = passed[left[~behind]]
        left = left[behind & hits.found]
        if len(left) == 0:
            break
        passed[left] *= 1 + 1e-9
    return found


def _pixels_of(box: Float64[np.ndarray, "8 3"], camera: Camera) -> Int32[np.ndarray, "n"]:
    """Pixels in the rectangle that the box projects into; all where it reaches behind the camera."""
    (u, v), z = _projected(box, camera)
    rows, columns = np.arange(camera.height), np.arange(camera.width)
    if (z > 1e-6).all():
        rows = rows[(rows + 1 > v.min()) & (rows < v.max())]
        columns = columns[(columns + 1 > u.min()) & (columns < u.max())]
    elif (z <= 1e-6).all():
        return np.zeros(0, np.int32)
    return (rows[:, None] * camera.width + columns).ravel().astype(np.int32)


def _projected(
    points: Float64[np.ndarray, "n 3"], camera: Camera
) -> tuple[Float64[np.ndarray, "2 n"], Float64[np.ndarray, "n"]]:
    """Pixel coordinates, NaN behind the camera, and depth."""
    pixels, z = camera.double().project(torch.from_numpy(points))
    return pixels.T.numpy(), z.numpy()


def _in_image(points: Float64[np.ndarray, "n 3"], camera: Camera) -> Bool[np.ndarray, "n"]:
    (u, v), z = _projected(points, camera)
    return (z > 1e-6) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)


def _points(view: DepthView) -> Float64[np.ndarray, "n 3"]:
    """World points of the pixels with depth."""
    points = view.camera.double().unproject_depth(torch.from_numpy(view.depth))
    return points.numpy()[np.isfinite(view.depth)]
