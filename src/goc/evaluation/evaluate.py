"""The judge: a run against a ground truth, by a protocol."""

from pathlib import Path

import numpy as np
import scipy

from goc import __version__
from goc.capture import load_capture
from goc.evaluation.judged import Judged, Task, finite, means
from goc.evaluation.labels import nearest_id
from goc.evaluation.matching import match_by_id, match_by_shape
from goc.evaluation.metrics import sample_surface
from goc.evaluation.prediction import read_prediction
from goc.evaluation.protocol_goc import judge_goc
from goc.evaluation.protocol_phyrecon import judge_phyrecon
from goc.evaluation.protocol_replica import judge_replica
from goc.evaluation.result import (
    Counts,
    Evaluation,
    ExtraObject,
    Matching,
    MeshChoice,
    ObjectEvaluation,
    Protocol,
)
from goc.evaluation.rooms import has_surface
from goc.evaluation.truth import read_truth
from goc.events import Listener, ignore
from goc.geometry.raycast import TriangleScene
from goc.scene import ROOM

_EXTRA_SAMPLES = 1_000


def evaluate(
    run: Path,
    truth: Path,
    protocol: Protocol = "goc",
    matching: Matching | None = None,
    meshes: MeshChoice = "best",
    seed: int = 0,
    notify: Listener = ignore,
) -> Evaluation:
    """Compare what a run made with the complete truth of its capture.

    Args:
        run: The output folder of `goc carve`, or a folder of <id>.ply and scene.ply; world of the capture, metres.
        truth: A capture with gt/, or a transforms file in one (whose views then are the training poses).
        protocol: How; see docs/guide/eval.md.
        matching: Which predicted object goes with which true one: of the same id, or by shape. None: by shape where
            the run's report says that it had no ids, else by id.
        meshes: Which mesh of each object.
        seed: Of all samples.
        notify: Hears progress.

    Raises:
        EvaluationError: the run is no such folder.
        CaptureError: a protocol needs the training poses, and the truth is no readable capture.
        FileError: a file of either is missing or malformed.
    """
    task, chosen = _task(run, truth, matching, meshes, seed)
    judged = _judge(protocol, truth, task, notify)
    mean, over = means(row for id, row in judged.objects.items() if id not in judged.skipped)
    objects = {id: _object(task, judged, id) for id in task.truth.objects}
    missing = [id for id in objects if id not in task.matches]
    return Evaluation(
        protocol=protocol,
        run=str(run),
        truth=str(truth),
        meshes=meshes,
        matching=chosen,
        settings=judged.settings | {"seed": seed},
        versions={"goc": __version__, "numpy": np.__version__, "scipy": scipy.__version__},
        counts=Counts(
            objects=len(objects),
            found=len(task.matches),
            missing=len(missing),
            extra=len(task.extra),
            skipped=len(judged.skipped),
            watertight=sum(item.watertight is True for item in objects.values()),
        ),
        mean=mean,
        mean_over=over,
        objects=objects,
        scene=None if judged.scene is None else finite(judged.scene),
        missing=missing,
        extra=_extra(task),
    )


def _task(run: Path, truth: Path, matching: Matching | None, meshes: MeshChoice, seed: int) -> tuple[Task, Matching]:
    known, made = read_truth(truth), read_prediction(run, meshes)
    chosen: Matching = matching or ("ids" if made.has_ids else "shape")
    candidates = {id: item.mesh for id, item in made.objects.items()}
    matches = match_by_id(candidates, known) if chosen == "ids" else match_by_shape(candidates, known, seed)
    extra = tuple(id for id in candidates if id not in matches.values() and has_surface(candidates[id]))
    return Task(truth=known, prediction=made, matches=matches, extra=extra, seed=seed), chosen


def _judge(protocol: Protocol, truth: Path, task: Task, notify: Listener) -> Judged:
    if protocol == "goc":
        return judge_goc(task, notify)
    cameras = load_capture(truth).cameras
    if protocol == "phyrecon-scannet":
        return judge_phyrecon(task, cameras, notify)
    return judge_replica(task, cameras, notify)


def _object(task: Task, judged: Judged, id: int) -> ObjectEvaluation:
    own = task.matches.get(id)
    found = None if own is None else task.prediction.objects[own]
    flaw = None if found is None else found.solid.flaw
    return ObjectEvaluation(
        label=task.truth.label(id),
        predicted=own,
        mesh=None if found is None else found.source,
        watertight=None if found is None else flaw is None,
        flaw=flaw,
        skipped=judged.skipped.get(id),
        figures=finite(judged.objects[id]),
    )


def _extra(task: Task) -> list[ExtraObject]:
    if not task.extra:
        return []
    meshes = {id: task.truth.mesh(id) for id in (ROOM, *task.truth.objects)}
    scenes = {id: TriangleScene(mesh.vertices, mesh.faces) for id, mesh in meshes.items()}
    found = []
    for own in task.extra:
        mesh = task.prediction.objects[own].mesh
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        at = nearest_id(sample_surface(mesh, _EXTRA_SAMPLES, task.seed).points, scenes)
        found.append(ExtraObject(predicted=own, area_m2=float(doubled.sum()) / 2, nearest_truth=at))
    return found
