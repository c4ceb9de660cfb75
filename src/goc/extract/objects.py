"""One open mesh an object, from its own pixels, with what was measured round it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32

from goc.errors import ExtractError
from goc.events import Listener, Warned, ignore
from goc.extract.cells import count_cells, object_cells
from goc.extract.clean import without_crumbs
from goc.extract.config import ExtractConfig
from goc.extract.depth import depth_views
from goc.extract.evidence import evidence_grid, evidence_volume
from goc.extract.fuse import voted_distance
from goc.extract.volume import Volume, blocks_near, surface
from goc.scene import ROOM, Capture, ObjectMesh

_CELL = 0.02
"""Edge of the cells that objects are found in, metres."""
_CLEAR_LOOK = 0.02
"""Weight of one clear look, cos θ / z²: facing the surface from 7 m, or at 60 degrees from 5 m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """An object that views see, and its empty volumes' sizes."""

    id: int
    cells: Int32[np.ndarray, "n 3"]
    blocks: Int32[np.ndarray, "b 3"]
    voxel: float
    evidence_blocks: int


def extract_objects(views: Capture, config: ExtractConfig, notify: Listener = ignore) -> tuple[ObjectMesh, ...]:
    """Mesh every object from the depth of its own pixels; other rays say where it is not.

    Args:
        views: Frames with depth and ids; ids above ROOM are objects. Labels of ids nobody sees are warned about.
        config: Voxels, votes and the evidence box.
        notify: Hears progress and warnings.

    Returns:
        Objects in the order of their ids, each an open mesh with its evidence grid, scene units.

    Raises:
        ExtractError: no view has ids, or none has depth.
    """
    if not views.has_ids:
        raise ExtractError(f"None of {len(views)} views has instance ids: objects cannot be told apart. Segment first.")
    size = _CELL * views.unit
    cells = count_cells(depth_views(views, "find objects", notify), size, by_id=True)
    present = sorted({int(i) for i in np.unique(cells.ids)} | set(views.labels) - {ROOM})
    found: list[_Found] = []
    for wanted in (i for i in present if i > ROOM):
        own = object_cells(cells, wanted)
        if len(own) == 0:
            notify(_missing(wanted, views))
        else:
            found.append(_measure(wanted, own, size, views.unit, config))
    meshes: list[ObjectMesh] = []
    for turn in _turns(found, config.memory_blocks):
        meshes += _extract(turn, views, size, config, notify)
    return tuple(meshes)


def _missing(wanted: int, views: Capture) -> Warned:
    name = f"{wanted} ({views.labels[wanted]})" if wanted in views.labels else f"{wanted}"
    return Warned(stage="extract", message=f"Object {name} is measured in none of {len(views)} views: no mesh for it.")


def _measure(wanted: int, own: Int32[np.ndarray, "n 3"], size: float, unit: float, config: ExtractConfig) -> _Found:
    longest = float((own.max(axis=0) + 1 - own.min(axis=0)).max()) * size
    voxel = min(config.object_voxel * unit, longest / config.object_cells)
    reach = config.truncation_voxels * voxel
    return _Found(
        id=wanted,
        cells=own,
        blocks=blocks_near(own, size, np.zeros(3), voxel, reach),
        voxel=voxel,
        evidence_blocks=len(evidence_volume(own, size, unit, config).blocks),
    )


def _turns(found: Sequence[_Found], budget: int) -> Iterator[list[_Found]]:
    """Objects in groups that fit into memory together; one that does not fit alone still gets its turn."""
    turn: list[_Found] = []
    used = 0
    for item in found:
        need = len(item.blocks) + item.evidence_blocks
        if turn and used + need > budget:
            yield turn
            turn, used = [], 0
        turn.append(item)
        used += need
    if turn:
        yield turn


def _extract(
    turn: Sequence[_Found], views: Capture, size: float, config: ExtractConfig, notify: Listener
) -> Iterator[ObjectMesh]:
    fine = [
        Volume(
            origin=np.zeros(3), voxel=item.voxel, truncation=config.truncation_voxels * item.voxel, blocks=item.blocks
        )
        for item in turn
    ]
    boxes = [evidence_volume(item.cells, size, views.unit, config) for item in turn]
    for view in depth_views(views, "fuse objects", notify):
        for item, volume, box in zip(turn, fine, boxes, strict=True):
            volume.add(view, item.id)
            box.add(view, item.id)
    for item, volume, box in zip(turn, fine, boxes, strict=True):
        cleaned = without_crumbs(surface(volume, voted_distance(volume, config)), config.crumb_share)
        if len(cleaned.mesh.faces) == 0:
            notify(_missing(item.id, views))
            continue
        yield ObjectMesh(
            id=item.id,
            label=views.labels.get(item.id, f"object {item.id}"),
            mesh=cleaned.mesh,
            observed=cleaned.weight * views.unit**2 >= _CLEAR_LOOK,
            evidence=evidence_grid(box, config),
        )
