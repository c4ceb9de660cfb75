"""Scores of a benchmark room: ten objects and the scene against complete ground truth."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from goc.errors import FileError
from goc.evaluation.metrics import SAMPLES, SurfaceSamples, SurfaceScores, sample_surface, surface_scores
from goc.scene import Mesh

SEEN_WITHIN = 0.015
"""A true surface point counts as seen where a sample of what the views saw lies this near, metres."""


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
        lengths = ("accuracy", "completion", "chamfer", "completion_seen", "completion_unseen")
        means = {name: _mean([getattr(score, name) for score in present]) for name in lengths}
        for threshold in everything[0].f_score:
            means[f"f_score_{threshold:g}"] = _mean([score.f_score[threshold] for score in everything])
        means["normal_consistency"] = _mean([score.normal_consistency for score in everything])
        return means


def score_room(capture: Path, objects: Mapping[int, Mesh], scene: Mesh | None = None) -> RoomScores:
    """Score meshes against `capture`/gt/points.npz.

    Each object: 30,000 area-uniform samples against the 30,000 of its true outer skin, F at 5 cm and 1 cm. The scene:
    as many samples as the truth has (250,000) against the samples of what the room's 170 views saw. True surface that
    no view saw is not asked of a scene. `seen` is judged by those samples too, whichever views a run was given.

    Raises:
        FileError: the ground truth is missing or lacks an array.
    """
    truth = _read_truth(capture / "gt" / "points.npz")
    ids = sorted(int(name[1:]) for name in truth if name.startswith("p"))
    seen = truth["seen"].astype(np.float64)
    scores = {
        id: surface_scores(
            _samples(objects.get(id), SAMPLES),
            SurfaceSamples(points=truth[f"p{id}"].astype(np.float64), normals=truth[f"n{id}"].astype(np.float64)),
            seen=_near(truth[f"p{id}"], seen[seen[:, 6] == id, :3]),
        )
        for id in ids
    }
    return RoomScores(
        objects=scores,
        scene=None
        if scene is None
        else surface_scores(_samples(scene, len(seen)), SurfaceSamples(points=seen[:, :3], normals=seen[:, 3:6])),
        missing=tuple(id for id in ids if _samples(objects.get(id), 1) is None),
    )


def _samples(mesh: Mesh | None, count: int) -> SurfaceSamples | None:
    return None if mesh is None or len(mesh.faces) == 0 else sample_surface(mesh, count)


def _near(points: np.ndarray, samples: np.ndarray) -> np.ndarray:
    if len(samples) == 0:
        return np.zeros(len(points), bool)
    return cKDTree(samples).query(points, distance_upper_bound=SEEN_WITHIN)[0] <= SEEN_WITHIN


def _read_truth(path: Path) -> dict[str, np.ndarray]:
    try:
        # Opened here: NumPy forgets to close a file that turns out to be no archive.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            truth = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise FileError(f"{path}: cannot be read ({error}). A benchmark room keeps its ground truth there.") from error
    ids = [name[1:] for name in truth if name.startswith("p")]
    lacking = [name for name in ["seen", *(f"n{id}" for id in ids)] if name not in truth]
    if lacking or not ids:
        first = lacking[0] if lacking else "p1"
        raise FileError(f"{path}: {max(1, len(lacking))} arrays are missing (first: {first}). Copy the room again.")
    return truth


def _mean(values: list[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")
