"""The scene mesh: TSDF fusion of all views (Newcombe et al. 2011) with vertex colours."""

import math

import numpy as np
import torch
from jaxtyping import Float32

from goc.device import CPU
from goc.errors import ExtractError
from goc.events import Listener, Warned, ignore
from goc.extract.clean import without_floaters
from goc.extract.config import ExtractConfig
from goc.fusion.cell_counts import CellCounts, count_cells
from goc.fusion.depth_views import depth_views
from goc.fusion.detail import DepthNoise, Detail, PixelSizes
from goc.fusion.device_volume import fuse_views
from goc.fusion.volume import BlockGrid, Volume, blocks_near, fused_surface
from goc.scene import Capture, Mesh

_SCENE_FLOATER_SHARE = 1e-4
"""Share of the scene's area below which a loose piece is a floater: 1 dm² in a room."""


def fuse_scene(
    views: Capture,
    config: ExtractConfig,
    notify: Listener = ignore,
    device: torch.device = CPU,
    noise: DepthNoise | None = None,
) -> Mesh:
    """Mesh everything the views saw, with colours; surfaces that nobody saw stay open.

    Args:
        views: Frames with depth; their ids are not looked at.
        config: Voxel and votes.
        notify: Hears progress, and a warning where the scene is too large for its voxel.
        device: Where views are fused.
        noise: Of the views' depth; it sets the band (`views_noise`). None: not known, pixels alone do.

    Raises:
        ExtractError: no view has depth, or no surface is left.
    """
    size = 2.0 * config.scene_voxel * views.units_per_metre
    sizes = PixelSizes()
    cells = count_cells(sizes.watched(depth_views(views, "find surfaces", notify)), size, by_id=False)
    detail = sizes.detail(None, noise)
    grid = _block_grid(cells, views.units_per_metre, config, notify, detail)
    (volume,) = fuse_views([grid], [None], depth_views(views, "fuse scene", notify), device)
    least = min(config.min_views, math.ceil(len(views) / 10))
    distance = np.where(volume.views >= least, voted_distance(volume, config), np.float32(np.nan))
    mesh = without_floaters(fused_surface(volume, distance), _SCENE_FLOATER_SHARE).mesh
    if len(mesh.faces) == 0:
        raise ExtractError(f"Fusing {len(views)} views left no surface: depth disagrees everywhere. Check the poses.")
    return mesh


def voted_distance(volume: Volume, config: ExtractConfig) -> Float32[np.ndarray, "b 8 8 8"]:
    """Signed distance with the votes counted: outside where rays passed, NaN where nothing or something else is."""
    weight, empty, other = (plane.reshape(-1) for plane in (volume.weight, volume.empty, volume.other))
    seen = np.flatnonzero(weight > 0)  # few of a grid's voxels: the rest of the work is theirs alone
    seen = seen[other[seen] <= config.other_votes * weight[seen]]
    carved = empty[seen] > config.empty_votes * weight[seen]
    voted = np.full(volume.weight.shape, np.nan, np.float32)
    voted.reshape(-1)[seen] = np.where(carved, np.float32(volume.grid.truncation), volume.distance_at(seen))
    return voted


def _block_grid(
    cells: CellCounts, units_per_metre: float, config: ExtractConfig, notify: Listener, detail: Detail
) -> BlockGrid:
    voxel, origin = config.scene_voxel * units_per_metre, np.zeros(3)
    while True:
        truncation = detail.band(voxel, config)
        blocks = blocks_near(cells.index, cells.size, origin, voxel, truncation)
        if len(blocks) <= config.memory_blocks:
            break
        voxel *= 2.0
    if voxel > config.scene_voxel * units_per_metre:
        message = (
            f"The scene is too large for voxels of {config.scene_voxel} m in {config.memory_blocks} blocks: "
            f"meshed with {voxel / units_per_metre:g} m. Raise --extract.memory-blocks for a finer mesh."
        )
        notify(Warned(stage="fuse scene", message=message))
    return BlockGrid(origin=origin, voxel=voxel, truncation=truncation, blocks=blocks)
