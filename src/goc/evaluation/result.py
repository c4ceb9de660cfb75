"""What an evaluation finds: the shape of eval.json."""

from typing import Literal

import msgspec

Protocol = Literal["goc", "phyrecon-scannet", "objectsdf-replica"]
MeshChoice = Literal["observed", "completed", "best"]
Matching = Literal["ids", "shape"]
Figures = dict[str, float | None]
"""Figures by name: lengths in metres, volumes in cubic metres, shares 0 to 1; None where one is not defined."""


class ObjectEvaluation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One true object and what was predicted for it."""

    label: str
    predicted: int | None
    """Id of the predicted object that is compared with it; null: missing."""
    mesh: Literal["observed", "completed", "file"] | None
    """Where the predicted mesh came from: objects/<id>/observed.ply, objects/<id>/mesh.ply or <id>.ply."""
    watertight: bool | None
    """Of the predicted mesh; null where it is missing."""
    flaw: str | None
    """Why it is not watertight."""
    skipped: str | None
    """Why the protocol leaves this object out of its means; null where it does not."""
    figures: Figures


class ExtraObject(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A predicted object that no true object is compared with."""

    predicted: int
    area_m2: float
    nearest_truth: int
    """Id that most of its surface is nearest to; 0 is the room."""


class Counts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Numbers of objects by outcome."""

    objects: int
    found: int
    missing: int
    extra: int
    skipped: int
    """Left out of the means by the protocol's own rule; always 0 for `goc`."""
    watertight: int


class Evaluation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of eval.json. The same run, truth and settings give the same bytes."""

    protocol: Protocol
    run: str
    truth: str
    meshes: MeshChoice
    matching: Matching
    settings: dict[str, float | int | str | list[float]]
    """Sample counts, thresholds and the seed, as they were used."""
    versions: dict[str, str]
    counts: Counts
    mean: Figures
    """Means over the objects. Shares (F, normals, labels, IoU, watertight) count a missing object as 0; lengths are
    means over the objects that have them, which is never a missing one: read `mean_over` and `missing` beside them."""
    mean_over: dict[str, int]
    """Number of objects in each mean."""
    objects: dict[int, ObjectEvaluation]
    """By true id, all of them."""
    scene: Figures | None
    """The whole scene's mesh; null where the run has none."""
    missing: list[int]
    """True ids without a prediction."""
    extra: list[ExtraObject]
