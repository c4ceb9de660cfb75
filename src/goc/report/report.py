"""report.json: what came out of a run, of what, how, on what."""

from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from goc import __version__
from goc.files import write_json
from goc.geometry.surfaces import face_areas
from goc.geometry.topology import is_watertight, signed_volume
from goc.runs.machine import Machine, peak_memory_mb, this_machine
from goc.runs.record import RunRecord
from goc.scene import Capture, DepthKind, Mesh, ObjectMesh, SceneAssets

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]


class CaptureFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What went in."""

    path: str
    views: int
    width: int
    height: int
    """Of the first view, pixels."""
    has_depth: bool
    depth_kind: DepthKind
    """Of the depth, where there is any: metric, or monocular (affine, inverse)."""
    has_ids: bool
    units_per_metre: float
    """Scene units in one metre."""
    metric: bool
    """The unit is known, not guessed: lengths below deserve their names."""


class SurfaceFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A mesh with the splats that belong to it."""

    vertices: int
    faces: int
    splats: int
    bounds: Bounds | None
    """Least and greatest corner of the vertices, scene units as in the files; null without vertices."""
    size_m: tuple[float, float, float]
    area_m2: float


class CompletionFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The closed surface of an object."""

    vertices: int
    faces: int
    completed_share: float
    """Share of its area that nobody measured: between vertices that were filled in."""
    watertight: bool
    """Checked: every edge on exactly two faces, consistent winding, no face without area, positive volume."""
    volume_m3: float
    area_m2: float


class ObjectFacts(SurfaceFacts, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One object."""

    id: int
    label: str
    observed_share: float
    """Share of the vertices that some camera measured well."""
    completion: CompletionFacts | None
    """Null where the object was not completed."""


class WarningFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Something that did not stop the run."""

    stage: str
    message: str


class Report(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of report.json."""

    goc: str
    """Version."""
    created: str
    """UTC, ISO 8601."""
    capture: CaptureFacts
    metrics: dict[str, float | None]
    """As the reconstruction measured them; null where a figure is not finite."""
    scene: SurfaceFacts
    objects: list[ObjectFacts]
    warnings: list[WarningFacts]
    seconds: dict[str, float]
    """Wall clock a stage; a resumed run counts only what it did itself."""
    peak_memory_mb: float
    machine: Machine
    seed: int
    config: dict[str, Any]
    """Every setting as it was used."""


def write_report(
    path: Path, source: Path, capture: Capture, assets: SceneAssets, record: RunRecord, config: "DataclassInstance"
) -> None:
    """Write report.json.

    Args:
        path: the file.
        source: where the capture came from.
        capture: as it was read: before ids or depth were added.
        assets: what came out.
        record: seconds and warnings.
        config: resolved settings, with `reconstruct.seed` among them.
    """
    settings = asdict(config)
    report = Report(
        goc=__version__,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        capture=_capture_facts(source, capture),
        metrics=dict(assets.reconstruction.metrics),
        scene=SurfaceFacts(**_surface(assets.scene, len(assets.reconstruction.gaussians), assets.units_per_metre)),
        objects=[_object_facts(item, assets) for item in assets.objects],
        warnings=[WarningFacts(stage=warning.stage, message=warning.message) for warning in record.warnings],
        seconds={stage: round(seconds, 2) for stage, seconds in record.seconds.items()},
        peak_memory_mb=round(peak_memory_mb(), 1),
        machine=this_machine(),
        seed=settings["reconstruct"]["seed"],
        config=settings,
    )
    write_json(path, report)


def _capture_facts(source: Path, capture: Capture) -> CaptureFacts:
    return CaptureFacts(
        path=str(source),
        views=len(capture),
        width=capture.cameras[0].width,
        height=capture.cameras[0].height,
        has_depth=capture.has_depth,
        depth_kind=capture.depth_kind,
        has_ids=capture.has_ids,
        units_per_metre=capture.units_per_metre,
        metric=capture.metric,
    )


def _object_facts(item: ObjectMesh, assets: SceneAssets) -> ObjectFacts:
    closed = next((other for other in assets.completed if other.id == item.id), None)
    splats = int((assets.reconstruction.labels == item.id).sum())
    return ObjectFacts(
        id=item.id,
        label=item.label,
        observed_share=round(float(item.observed.mean()), 4) if len(item.observed) else 0.0,
        completion=None if closed is None else _completion_facts(closed, assets.units_per_metre),
        **_surface(item.mesh, splats, assets.units_per_metre),
    )


def _completion_facts(closed: ObjectMesh, units_per_metre: float) -> CompletionFacts:
    return CompletionFacts(
        vertices=len(closed.mesh.vertices),
        faces=len(closed.mesh.faces),
        completed_share=round(filled_share(closed), 4),
        watertight=is_watertight(closed.mesh),
        volume_m3=round(signed_volume(closed.mesh) / units_per_metre**3, 9),
        area_m2=round(float(face_areas(closed.mesh).sum()) / units_per_metre**2, 4),
    )


def filled_share(closed: ObjectMesh) -> float:
    """Share of a completed object's area that was filled in: that of its faces' corners which were not observed."""
    areas = face_areas(closed.mesh)
    filled = 1.0 - closed.observed[closed.mesh.faces].mean(axis=1)
    return float((areas * filled).sum() / max(float(areas.sum()), 1e-30))


def _surface(mesh: Mesh, splats: int, units_per_metre: float) -> dict[str, Any]:
    bounds = None
    size = (0.0, 0.0, 0.0)
    if len(mesh.vertices):
        low, high = mesh.vertices.min(0).tolist(), mesh.vertices.max(0).tolist()
        bounds = (tuple(low), tuple(high))
        size = tuple(round((b - a) / units_per_metre, 4) for a, b in zip(low, high, strict=True))
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "splats": splats,
        "bounds": bounds,
        "size_m": size,
        "area_m2": round(float(face_areas(mesh).sum()) / units_per_metre**2, 4),
    }
