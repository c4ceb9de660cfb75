"""Surface scores of a room: its objects and the scene against complete ground truth."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from goc.evaluation.metrics import SAMPLES, SurfaceSamples, SurfaceScores, sample_surface, surface_scores
from goc.evaluation.truth import Truth, read_truth
from goc.scene import Mesh

LENGTHS = (
    "accuracy",
    "accuracy_seen",
    "accuracy_unseen",
    "completion",
    "completion_seen",
    "completion_unseen",
    "chamfer",
)


@dataclass(frozen=True, kw_only=True)
class RoomScores:
    """All scores of a room, metres."""

    objects: dict[int, SurfaceScores]
    """By id, every id of the ground truth; a missing object has F = 0 and infinite completion."""
    scene: SurfaceScores | None
    """The scene mesh against the seen samples; None where no scene was given."""
    missing: tuple[int, ...]

    def mean(self) -> dict[str, float]:
        """Means over the objects. F and NC count a missing object as 0; lengths are over the objects present.

        A mean of lengths with a missing object in it would be infinite, and hide the rest: read `missing` beside it.
        """
        present = [score for id, score in self.objects.items() if id not in self.missing]
        everything = list(self.objects.values())
        means = {name: _mean([getattr(score, name) for score in present]) for name in LENGTHS}
        for threshold in everything[0].f_score:
            means[f"f_score_{threshold:g}"] = _mean([score.f_score[threshold] for score in everything])
        means["normal_consistency"] = _mean([score.normal_consistency for score in everything])
        return means


def score_room(capture: Path, objects: Mapping[int, Mesh], scene: Mesh | None = None) -> RoomScores:
    """Score meshes against `capture`/gt/points.npz; see `score_surfaces`.

    Raises:
        FileError: the ground truth is missing or lacks an array.
    """
    return score_surfaces(read_truth(capture), objects, scene)


def score_surfaces(truth: Truth, objects: Mapping[int, Mesh], scene: Mesh | None, seed: int = 0) -> RoomScores:
    """Score meshes, by true id, against the samples of the truth.

    Each object: 30,000 area-uniform samples against the 30,000 of its true outer skin, F at 5 cm and 1 cm. The scene:
    as many samples as the truth has (250,000) against the samples of what the room's views saw. True surface that
    no view saw is not asked of a scene. `seen` is judged by those samples too, whichever views a run was given.
    """
    scores = {
        id: surface_scores(samples_of(objects.get(id), SAMPLES, seed), true.samples, seen=true.seen)
        for id, true in truth.objects.items()
    }
    count = len(truth.seen)
    return RoomScores(
        objects=scores,
        scene=None if scene is None else surface_scores(samples_of(scene, count, seed), truth.seen),
        missing=tuple(id for id in truth.objects if samples_of(objects.get(id), 1, seed) is None),
    )


def samples_of(mesh: Mesh | None, count: int, seed: int) -> SurfaceSamples | None:
    """Area-uniform samples, None where there is no surface."""
    return None if mesh is None or not has_surface(mesh) else sample_surface(mesh, count, seed)


def has_surface(mesh: Mesh) -> bool:
    """Whether a mesh has any face with area."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    return bool(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any())


def _mean(values: list[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")
