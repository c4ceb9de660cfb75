"""Result of an evaluation: the schema of eval.json."""

from typing import Literal

import msgspec

Protocol = Literal["goc", "phyrecon-scannet", "objectsdf-replica"]
MeshChoice = Literal["observed", "completed", "best"]
Matching = Literal["ids", "shape"]
Figures = dict[str, float | None]
"""Figures by name: lengths in metres, volumes in cubic metres, shares 0 to 1; None where one is not defined."""


class ObjectEvaluation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One true object and the prediction that is compared with it."""

    label: str
    predicted: int | None
    """Id of the predicted object that is compared with it; null if there is none."""
    mesh: Literal["observed", "completed", "file"] | None
    """File of the predicted mesh: objects/<id>/observed.ply, objects/<id>/mesh.ply or <id>.ply; null if missing."""
    watertight: bool | None
    """Whether the predicted mesh is watertight; null if it is missing."""
    flaw: str | None
    """Why the predicted mesh is not watertight; else null."""
    skipped: str | None
    """Why the protocol leaves this object out of the means; null if it counts."""
    figures: Figures


class ExtraObject(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A predicted object that is compared with no true object."""

    predicted: int
    area_m2: float
    nearest_truth: int
    """Id of the true object that most of its surface is nearest to; 0 is the room."""


class Counts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Numbers of objects by outcome."""

    objects: int
    found: int
    missing: int
    extra: int
    skipped: int
    """Objects that a rule of the protocol leaves out of the means; always 0 for `goc`."""
    watertight: int


class Evaluation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of eval.json. Equal runs, truth and settings give equal bytes."""

    protocol: Protocol
    run: str
    truth: str
    meshes: MeshChoice
    matching: Matching
    settings: dict[str, float | int | str | list[float]]
    """Sample counts, thresholds and the seed of this evaluation."""
    versions: dict[str, str]
    counts: Counts
    mean: Figures
    """Means over the objects. Shares (F, normals, labels, IoU, watertight) count a missing object as 0; lengths are
    means over the objects that have them, never a missing one, so read `mean_over` and `missing` too."""
    mean_over: dict[str, int]
    """Number of objects in each mean."""
    deepest: Figures
    """Greatest `penetration_depth`, `room_depth` and `bottom_error` of any object, where the protocol has them."""
    objects: dict[int, ObjectEvaluation]
    """All true objects, by id."""
    scene: Figures | None
    """Figures of the mesh of the whole scene; null if the run has none."""
    missing: list[int]
    """Ids of the true objects without a prediction."""
    extra: list[ExtraObject]
