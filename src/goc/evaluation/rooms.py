"""Surface scores of a room: its objects and the scene against complete ground truth."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from goc.evaluation.metrics import SAMPLES, SurfaceSamples, SurfaceScores, sample_surface, surface_scores
from goc.evaluation.truth import Truth
from goc.scene import Mesh


@dataclass(frozen=True, kw_only=True)
class RoomScores:
    """All scores of a room, metres."""

    objects: dict[int, SurfaceScores]
    """By id, every id of the ground truth; a missing object has F = 0 and infinite completion."""
    scene: SurfaceScores | None
    """The scene mesh against the seen samples; None where no scene was given."""


def score_surfaces(truth: Truth, objects: Mapping[int, Mesh], scene: Mesh | None, seed: int = 0) -> RoomScores:
    """Score meshes, by true id, against the samples of the truth.

    Each object: 30,000 area-uniform samples against the 30,000 of its true outer skin, F at 5 cm and 1 cm. The scene:
    as many samples as the truth has (250,000) against the samples of what the room's views saw. True surface that
    no view saw is not asked of a scene. `seen` is judged by those samples too, whichever views a run was given.
    """
    scores = {
        id: surface_scores(_samples_of(objects.get(id), SAMPLES, seed), true.samples, seen=true.seen)
        for id, true in truth.objects.items()
    }
    count = len(truth.seen)
    return RoomScores(
        objects=scores,
        scene=None if scene is None else surface_scores(_samples_of(scene, count, seed), truth.seen),
    )


def _samples_of(mesh: Mesh | None, count: int, seed: int) -> SurfaceSamples | None:
    """Area-uniform samples, None where there is no surface."""
    return None if mesh is None or not has_surface(mesh) else sample_surface(mesh, count, seed)


def has_surface(mesh: Mesh) -> bool:
    """Whether a mesh has any face with area."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    return bool(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any())
