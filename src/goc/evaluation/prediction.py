"""What a run made: the meshes of its objects and of its scene."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import msgspec

from goc.errors import EvaluationError
from goc.evaluation.result import MeshChoice
from goc.evaluation.volumes import SolidMesh
from goc.files import is_file, is_folder, read_json, read_mesh
from goc.scene import Mesh

_OBSERVED, _COMPLETED = "observed.ply", "mesh.ply"


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


class _CaptureFacts(msgspec.Struct):
    has_ids: bool = True


class _Report(msgspec.Struct):
    """The one thing evaluation asks of a report.json."""

    capture: _CaptureFacts = msgspec.field(default_factory=_CaptureFacts)


def read_prediction(run: Path, meshes: MeshChoice) -> Prediction:
    """Read the output folder of `goc carve`, or a folder of <id>.ply with an optional scene.ply.

    Args:
        run: holds objects/<id>/, or <id>.ply.
        meshes: `observed` takes objects/<id>/observed.ply, `completed` objects/<id>/mesh.ply, and `best` the latter
            where it is there. A folder of <id>.ply has no such choice.

    Raises:
        EvaluationError: the folder is neither.
        FileError: a file in it is malformed.
    """
    if not is_folder(run):
        raise EvaluationError(f"{run}: not found. Give the output folder of goc carve, or a folder of <id>.ply.")
    report = run / "report.json"
    scene = next((path for path in (run / "scene/mesh.ply", run / "scene.ply") if is_file(path)), None)
    return Prediction(
        objects=_carved(run / "objects", meshes) if is_folder(run / "objects") else _loose(run),
        scene=None if scene is None else read_mesh(scene),
        has_ids=read_json(report, _Report).capture.has_ids if is_file(report) else True,
    )


def _carved(folder: Path, meshes: MeshChoice) -> dict[int, PredictedObject]:
    found = {}
    for own in sorted((entry for entry in folder.iterdir() if _is_id(entry.name)), key=lambda entry: int(entry.name)):
        if meshes != "observed" and is_file(own / _COMPLETED):
            found[int(own.name)] = PredictedObject(mesh=read_mesh(own / _COMPLETED), source="completed")
        elif meshes != "completed" and is_file(own / _OBSERVED):
            found[int(own.name)] = PredictedObject(mesh=read_mesh(own / _OBSERVED), source="observed")
    return found


def _loose(folder: Path) -> dict[int, PredictedObject]:
    paths = {int(path.stem): path for path in folder.glob("*.ply") if _is_id(path.stem)}
    if not paths:
        raise EvaluationError(
            f"{folder}: holds no objects/<id>/{_OBSERVED} and no <id>.ply. "
            "Give the output folder of goc carve, or name the meshes by the ids of the ground truth."
        )
    return {id: PredictedObject(mesh=read_mesh(paths[id]), source="file") for id in sorted(paths)}


def _is_id(name: str) -> bool:
    return name.isdecimal() and name.isascii() and not name.startswith("0")
