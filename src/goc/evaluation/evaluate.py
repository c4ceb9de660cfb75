"""Scores a run against a ground truth by a protocol."""

from pathlib import Path

import numpy as np
import scipy

from goc import __version__
from goc.capture import load_capture
from goc.evaluation.labels import nearest_id
from goc.evaluation.matching import match_by_id, match_by_shape
from goc.evaluation.metrics import sample_surface
from goc.evaluation.prediction import read_prediction
from goc.evaluation.protocols.goc import score_goc
from goc.evaluation.protocols.phyrecon import score_phyrecon
from goc.evaluation.protocols.protocol import MatchedRun, ProtocolResult, deepest, finite, means
from goc.evaluation.protocols.replica import score_replica
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
from goc.evaluation.scale import scale_doubt
from goc.evaluation.truth import read_truth
from goc.events import Listener, Warned, ignore
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
        notify: Hears progress, and a warning where the run is in another unit or frame than the truth.

    Raises:
        EvaluationError: the run is no such folder.
        CaptureError: a protocol needs the training poses, and the truth is no readable capture.
        FileError: a file of either is missing or malformed.
    """
    matched, chosen = _match(run, truth, matching, meshes, seed)
    doubt = scale_doubt(matched.prediction, matched.truth)
    if doubt is not None:
        notify(Warned(stage="eval", message=f"{run}: {doubt}"))
    result = _score(protocol, truth, matched, notify)
    mean, over = means(row for id, row in result.objects.items() if id not in result.skipped)
    objects = {id: _object(matched, result, id) for id in matched.truth.objects}
    missing = [id for id in objects if id not in matched.matches]
    return Evaluation(
        protocol=protocol,
        run=str(run),
        truth=str(truth),
        meshes=meshes,
        matching=chosen,
        settings=result.settings | {"seed": seed},
        versions={"goc": __version__, "numpy": np.__version__, "scipy": scipy.__version__},
        counts=Counts(
            objects=len(objects),
            found=len(matched.matches),
            missing=len(missing),
            extra=len(matched.extra),
            skipped=len(result.skipped),
            watertight=sum(item.watertight is True for item in objects.values()),
        ),
        mean=mean,
        mean_over=over,
        deepest=deepest(result.objects.values()),
        objects=objects,
        scene=None if result.scene is None else finite(result.scene),
        missing=missing,
        extra=_extra(matched),
    )


def _match(
    run: Path, truth: Path, matching: Matching | None, meshes: MeshChoice, seed: int
) -> tuple[MatchedRun, Matching]:
    known, made = read_truth(truth), read_prediction(run, meshes)
    chosen: Matching = matching or ("ids" if made.has_ids else "shape")
    candidates = {id: item.mesh for id, item in made.objects.items()}
    matches = match_by_id(candidates, known) if chosen == "ids" else match_by_shape(candidates, known, seed)
    extra = tuple(id for id in candidates if id not in matches.values() and has_surface(candidates[id]))
    return MatchedRun(truth=known, prediction=made, matches=matches, extra=extra, seed=seed), chosen


def _score(protocol: Protocol, truth: Path, matched: MatchedRun, notify: Listener) -> ProtocolResult:
    if protocol == "goc":
        return score_goc(matched, notify)
    cameras = load_capture(truth).cameras
    if protocol == "phyrecon-scannet":
        return score_phyrecon(matched, cameras, notify)
    return score_replica(matched, cameras, notify)


def _object(matched: MatchedRun, result: ProtocolResult, id: int) -> ObjectEvaluation:
    own = matched.matches.get(id)
    found = None if own is None else matched.prediction.objects[own]
    flaw = None if found is None else found.solid.flaw
    return ObjectEvaluation(
        label=matched.truth.label(id),
        predicted=own,
        mesh=None if found is None else found.source,
        watertight=None if found is None else flaw is None,
        flaw=flaw,
        skipped=result.skipped.get(id),
        figures=finite(result.objects[id]),
    )


def _extra(matched: MatchedRun) -> list[ExtraObject]:
    if not matched.extra:
        return []
    meshes = {id: matched.truth.mesh(id) for id in (ROOM, *matched.truth.objects)}
    scenes = {id: TriangleScene(mesh.vertices, mesh.faces) for id, mesh in meshes.items()}
    found = []
    for own in matched.extra:
        mesh = matched.prediction.objects[own].mesh
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        at = nearest_id(sample_surface(mesh, _EXTRA_SAMPLES, matched.seed).points, scenes)
        found.append(ExtraObject(predicted=own, area_m2=float(doubled.sum()) / 2, nearest_truth=at))
    return found
