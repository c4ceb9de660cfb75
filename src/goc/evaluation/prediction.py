"""The prediction to be scored: meshes of a run's objects and of its scene."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from goc.errors import EvaluationError
from goc.evaluation.result import MeshChoice
from goc.evaluation.volumes import SolidMesh
from goc.files import SurfaceKind, is_file, is_folder, read_mesh, read_meshes
from goc.files.layout import REPORT, SCENE_MESH
from goc.report import read_report
from goc.scene import Mesh

_SURFACES: dict[MeshChoice, tuple[SurfaceKind, ...]] = {
    "observed": ("observed",),
    "completed": ("solid",),
    "best": ("solid", "observed"),
}
_SOURCES: dict[SurfaceKind, Literal["observed", "completed"]] = {"observed": "observed", "solid": "completed"}


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedObject:
    """One object's mesh."""

    mesh: Mesh
    source: Literal["observed", "completed", "file"]

    @cached_property
    def solid(self) -> SolidMesh:
        """For what is asked of it as a body."""
        return SolidMesh(self.mesh)


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """All meshes of a run, world, metres."""

    objects: dict[int, PredictedObject]
    """By predicted id, ascending."""
    scene: Mesh | None
    has_ids: bool
    """The predicted ids are those of the capture; False where the run made up its own."""


def read_prediction(run: Path, meshes: MeshChoice) -> Prediction:
    """Read the output folder of `goc carve`, or a folder of <id>.ply with an optional scene.ply.

    Args:
        run: holds objects/<id>/, or <id>.ply.
        meshes: `observed` takes objects/<id>/observed.ply, `completed` objects/<id>/mesh.ply, and `best` the latter
            where it is there. A folder of <id>.ply has no such choice.

    Raises:
        EvaluationError: the folder is neither.
        FileError: a file in it is missing, malformed, or of another version of goc.
    """
    if not is_folder(run):
        raise EvaluationError(f"{run}: not found. Give the output folder of goc carve, or a folder of <id>.ply.")
    report = run / REPORT
    scene = next((path for path in (run / SCENE_MESH, run / "scene.ply") if is_file(path)), None)
    return Prediction(
        objects=_carved(run, meshes) if is_folder(run / "objects") else _loose(run),
        scene=None if scene is None else read_mesh(scene),
        has_ids=read_report(report).capture.has_ids if is_file(report) else True,
    )


def _carved(run: Path, meshes: MeshChoice) -> dict[int, PredictedObject]:
    found = read_meshes(run, _SURFACES[meshes])
    return {id: PredictedObject(mesh=mesh, source=_SOURCES[kind]) for id, (kind, mesh) in found.items()}


def _loose(folder: Path) -> dict[int, PredictedObject]:
    paths = {int(path.stem): path for path in folder.glob("*.ply") if _is_id(path.stem)}
    if not paths:
        raise EvaluationError(
            f"{folder}: holds no objects/<id>/observed.ply and no <id>.ply. "
            "Give the output folder of goc carve, or name the meshes by the ids of the ground truth."
        )
    return {id: PredictedObject(mesh=read_mesh(paths[id]), source="file") for id in sorted(paths)}


def _is_id(name: str) -> bool:
    return name.isdecimal() and name.isascii() and not name.startswith("0")
