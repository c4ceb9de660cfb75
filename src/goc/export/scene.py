"""Files of a scene and its objects that a tool can open."""

from pathlib import Path

from goc.export.config import ExportConfig
from goc.files import write_glb, write_mesh, write_png, write_splats
from goc.geometry.surfaces import vertex_normals
from goc.report.overview import draw_overview, up_of
from goc.runs.output import (
    OBJECT_CLOSED,
    OBJECT_GLB,
    OBJECT_MESH,
    OBJECT_SPLATS,
    OVERVIEW,
    SCENE_MESH,
    SCENE_SPLATS,
    object_folder,
)
from goc.runs.record import RunRecord
from goc.scene import Capture, SceneAssets


def export_scene(
    assets: SceneAssets, views: Capture, folder: Path, title: str, config: ExportConfig, run: RunRecord
) -> None:
    """Write meshes, splats and overview.png; layout in docs/guide/output.md.

    Args:
        assets: what came out.
        views: photographs with the splats' depth and ids, for overview.png.
        folder: existing files of the same names are replaced.
        title: what the capture is called.
        config: what to write.
        run: hears progress; its warnings are shown in overview.png.

    Raises:
        FileError: a number is not finite, or the disk refuses.
    """
    splats = assets.reconstruction.gaussians
    write_mesh(folder / SCENE_MESH, assets.scene)
    write_splats(folder / SCENE_SPLATS, splats)
    for item in assets.objects:
        own = object_folder(item.id)
        write_mesh(folder / own / OBJECT_MESH, item.mesh, item.observed)
        write_splats(folder / own / OBJECT_SPLATS, splats[assets.reconstruction.labels == item.id])
    for item in assets.completed:
        own = folder / object_folder(item.id)
        write_mesh(own / OBJECT_CLOSED, item.mesh, item.observed)
        write_glb(
            own / OBJECT_GLB, item.mesh, vertex_normals(item.mesh), up_of(views), assets.units_per_metre, item.label
        )
    write_png(folder / OVERVIEW, draw_overview(assets, views, title, config.overview_views, run))
