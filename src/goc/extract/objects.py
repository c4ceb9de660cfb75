"""One open mesh an object, from its own pixels, with what was measured round it."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import torch
from jaxtyping import Int32

from goc.device import CPU
from goc.errors import ExtractError
from goc.events import Listener, Warned, ignore
from goc.extract.clean import without_floaters
from goc.extract.config import ExtractConfig
from goc.extract.fuse import voted_distance
from goc.fusion.cell_counts import count_cells, object_cells
from goc.fusion.depth_views import DepthView, depth_views
from goc.fusion.detail import DepthNoise, Detail, PixelSizes
from goc.fusion.device_volume import fuse_views
from goc.fusion.evidence import evidence_block_grid, evidence_grid
from goc.fusion.volume import BlockGrid, FusedSurface, Volume, blocks_near, fused_surface
from goc.scene import ROOM, Capture, EvidenceGrid, FlaggedMesh, SceneObject

_CELL = 0.02
"""Edge of the cells that objects are found in, metres."""
_CLEAR_LOOK = 0.02
"""Weight of one clear look, cos θ / z²: facing the surface from 7 m, or at 60 degrees from 5 m."""


def extract_objects(
    views: Capture,
    config: ExtractConfig,
    notify: Listener = ignore,
    device: torch.device = CPU,
    noise: DepthNoise | None = None,
) -> tuple[SceneObject, ...]:
    """Mesh every object from the depth of its own pixels; other rays say where it is not.

    Args:
        views: Frames with depth and ids; ids above ROOM are objects. Labels of ids nobody sees are warned about.
        config: Voxels, votes and the evidence box.
        notify: Hears progress and warnings.
        device: Where views are fused.
        noise: Of the views' depth; with the pixels' size it sets voxels and bands (`views_noise`). None: not known.

    Returns:
        Objects in the order of their ids, each with its open `observed` surface and its evidence, scene units.

    Raises:
        ExtractError: no view has ids, or none has depth.
    """
    if not views.has_ids:
        raise ExtractError(f"None of {len(views)} views has instance ids: objects cannot be told apart. Segment first.")

    def depths(stage: str) -> Callable[[], Iterator[DepthView]]:
        return lambda: depth_views(views, stage, notify)

    grids, details = _object_grids(views, depths("find objects")(), config, noise, notify)
    surfaces: dict[int, FusedSurface] = {}
    for wanted, volume in _fused_volumes(grids, depths("fuse objects"), config, device):
        cleaned = without_floaters(fused_surface(volume, voted_distance(volume, config)), config.floater_share)
        if len(cleaned.mesh.faces) > 0:
            surfaces[wanted] = cleaned
        else:
            notify(_missing(wanted, views))
    boxes = {
        wanted: evidence_block_grid(found.mesh.vertices, views.units_per_metre, config, details[wanted])
        for wanted, found in surfaces.items()
    }
    return tuple(
        _open_object(wanted, surfaces[wanted], evidence_grid(box, surfaces[wanted].mesh.vertices, config), views)
        for wanted, box in _fused_volumes(boxes, depths("gather evidence"), config, device)
    )


def _missing(wanted: int, views: Capture) -> Warned:
    name = f"{wanted} ({views.id_names[wanted]})" if wanted in views.id_names else f"{wanted}"
    return Warned(stage="extract", message=f"Object {name} is measured in none of {len(views)} views: no mesh for it.")


def _open_object(wanted: int, found: FusedSurface, evidence: EvidenceGrid, views: Capture) -> SceneObject:
    clear = found.weight * views.units_per_metre**2 >= _CLEAR_LOOK
    return SceneObject(
        id=wanted,
        name=views.id_names.get(wanted, f"object {wanted}"),
        observed=FlaggedMesh(mesh=found.mesh, observed=clear),
        evidence=evidence,
    )


def _object_grids(
    views: Capture, depths: Iterator[DepthView], config: ExtractConfig, noise: DepthNoise | None, notify: Listener
) -> tuple[dict[int, BlockGrid], dict[int, Detail]]:
    """Where each object is, as the voxels round it, and how finely it was measured."""
    sizes = PixelSizes()
    cells = count_cells(sizes.watched(depths), _CELL * views.units_per_metre, by_id=True)
    grids: dict[int, BlockGrid] = {}
    details: dict[int, Detail] = {}
    for wanted in sorted({int(i) for i in np.unique(cells.ids)} | set(views.id_names)):
        own = object_cells(cells, wanted) if wanted > ROOM else None
        if own is not None and len(own) > 0:
            details[wanted] = sizes.detail(wanted, noise)
            grids[wanted] = _object_grid(own, cells.size, views.units_per_metre, config, details[wanted])
        elif own is not None:
            notify(_missing(wanted, views))
    return grids, details


def _object_grid(
    own: Int32[np.ndarray, "n 3"], size: float, units_per_metre: float, config: ExtractConfig, detail: Detail
) -> BlockGrid:
    longest = float((own.max(axis=0) + 1 - own.min(axis=0)).max()) * size
    voxel = max(
        min(config.object_voxel * units_per_metre, longest / config.object_cells),
        detail.finest(config, units_per_metre),
    )
    reach = detail.band(voxel, config)
    blocks = blocks_near(own, size, np.zeros(3), voxel, reach)
    return BlockGrid(origin=np.zeros(3), voxel=voxel, truncation=reach, blocks=blocks)


def _fused_volumes(
    grids: Mapping[int, BlockGrid],
    depths: Callable[[], Iterator[DepthView]],
    config: ExtractConfig,
    device: torch.device,
) -> Iterator[tuple[int, Volume]]:
    """Fuse all views onto each object's grid, as many objects at a time as memory allows."""
    waiting = list(grids)
    while waiting:
        turn = [waiting.pop(0)]
        used = len(grids[turn[0]].blocks)
        while waiting and used + len(grids[waiting[0]].blocks) <= config.memory_blocks:
            turn.append(waiting.pop(0))
            used += len(grids[turn[-1]].blocks)
        yield from zip(turn, fuse_views([grids[wanted] for wanted in turn], turn, depths(), device), strict=True)
