"""The formats that a scene is written in: one function a format, and the table of them."""

from collections.abc import Callable
from pathlib import Path

from goc.files import object_files, write_glb, write_scene
from goc.geometry.surfaces import vertex_normals
from goc.scene import Scene

Writer = Callable[[Path, Scene], None]
"""Writes its files of a scene into a folder; existing files of the same names are replaced."""


def export_scene(folder: Path, scene: Scene) -> None:
    """Write a scene in every format of `WRITERS`; layout in docs/guide/output.md.

    Args:
        folder: made if need be; existing files of the same names are replaced.
        scene: in the world of the capture.

    Raises:
        FileError: a number is not finite, or the disk refuses.
    """
    for write in WRITERS.values():
        write(folder, scene)


def _write_glb(folder: Path, scene: Scene) -> None:
    """Closed objects as GLB, in the frame of exports."""
    for item in scene.objects:
        if item.solid is not None:
            mesh, path = item.solid.mesh, object_files(folder, item.id).glb
            write_glb(path, mesh, vertex_normals(mesh), scene.world.level_from_world, item.name)


WRITERS: dict[str, Writer] = {"ply": write_scene, "glb": _write_glb}
"""By format. A writer keeps to the world of the capture and says so, or uses `scene.world.level_from_world`."""
