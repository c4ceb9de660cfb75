"""report.json: input, results, settings, times and machine of a run."""

from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from goc import __version__
from goc.extract import DepthError
from goc.files import read_versioned, write_json
from goc.geometry.surfaces import face_areas
from goc.geometry.topology import is_watertight, signed_volume
from goc.runs.machine import Machine, peak_memory_mb, this_machine
from goc.runs.record import RunRecord
from goc.scene import Capture, Completed, Contact, DepthKind, FlaggedMesh, Mesh, Scene, SceneObject, World

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

VERSION = 1
"""Version of the schema of report.json. Raise it whenever a field is removed or changes its meaning."""

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]


class CaptureFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The capture that was carved."""

    path: str
    views: int
    width: int
    height: int
    """Width and height of the first view, pixels."""
    has_depth: bool
    depth_kind: DepthKind
    """Meaning of the depth, where there is any: metric, or monocular (affine, inverse)."""
    has_ids: bool
    units_per_metre: float
    """Scene units in one metre."""
    metric: bool
    """Whether the unit is known; if it is guessed, so are all lengths in metres below."""


class WorldFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Up and the floor, and the transform from the capture's world to the frame of exports."""

    up: Vector
    """Unit vector in the world of the capture."""
    floor: float
    """Height of the floor along up, scene units."""
    confidence: float
    """Confidence in up and floor together, 0 to 1."""
    level_from_world: tuple[Row, Row, Row, Row]
    """Rows of the transform from the capture's world to metres, z up, floor at z = 0; GLB holds (x, z, -y) of it."""


class SurfaceFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A mesh with the splats that belong to it."""

    vertices: int
    faces: int
    splats: int
    bounds: tuple[Vector, Vector] | None
    """Least and greatest corner of the vertices, scene units as in the files; null without vertices."""
    size_m: Vector
    area_m2: float


class CompletionFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The closed surface of an object."""

    vertices: int
    faces: int
    completed_share: float
    """Share of its area that was filled in and not measured."""
    watertight: bool
    """Checked: every edge on exactly two faces, consistent winding, no face without area, positive volume."""
    volume_m3: float
    area_m2: float
    method: str | None = None
    """What filled in the unknown: a candidate of `best`, or the method that was asked for; null if not known."""
    expected_error_m: float | None = None
    """Mean distance to the true surface that is to be expected; null where nothing foretells it."""
    trusted: bool | None = None
    """Whether that is no more than leaving the surface open would cost."""


class DepthErrorFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the splats' depth is from the given one, over the pixels of one object."""

    median_m: float
    """Above 0: the splats lie behind."""
    mad_m: float
    """Median distance from that median."""
    pixels: int
    """That were compared."""


class ContactFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What an object stands on."""

    on: list[int]
    """Ids of what bears it; 0 is the floor, or another level part of the room."""
    height_m: float
    """Of the contact above the world's floor."""
    confidence: float


class ObjectFacts(SurfaceFacts, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One object."""

    id: int
    label: str
    observed_share: float
    """Share of the vertices that at least one camera measured well."""
    completion: CompletionFacts | None
    """Null where the object was not completed."""
    depth_error: DepthErrorFacts | None = None
    """Null where the capture has no metric depth there."""
    contact: ContactFacts | None = None
    """Null where nothing was found that bears it."""


class WarningFacts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A warning, which did not stop the run."""

    stage: str
    message: str


class Report(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of report.json."""

    schema: int
    goc: str
    """Version of goc that wrote it."""
    created: str
    """UTC, ISO 8601."""
    capture: CaptureFacts
    metrics: dict[str, float | None]
    """Figures of the reconstruction by name; null where one is not finite."""
    world: WorldFacts
    scene: SurfaceFacts
    objects: list[ObjectFacts]
    warnings: list[WarningFacts]
    seconds: dict[str, float]
    """Wall-clock seconds of each stage; a resumed run counts only its own part."""
    peak_memory_mb: float
    machine: Machine
    seed: int
    config: dict[str, Any]
    """Every setting of the run."""


def read_report(path: Path) -> Report:
    """Read report.json.

    Raises:
        FileError: missing, malformed, or of another version.
    """
    return read_versioned(path, Report, VERSION, "Carve again with --overwrite")


def write_report(
    path: Path,
    source: Path,
    capture: Capture,
    scene: Scene,
    record: RunRecord,
    config: "DataclassInstance",
    errors: Mapping[int, DepthError] | None = None,
) -> None:
    """Write report.json.

    Args:
        path: the file.
        source: path of the capture.
        capture: the capture as it was read, before ids or depth were added.
        scene: the result.
        record: seconds and warnings of the run.
        config: all settings, with `reconstruct.seed` among them.
        errors: of the splats' depth, by id, where the capture has metric depth.
    """
    settings, unit = asdict(config), scene.world.units_per_metre
    report = Report(
        schema=VERSION,
        goc=__version__,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        capture=_capture_facts(source, capture),
        metrics=dict(scene.metrics),
        world=_world_facts(scene),
        scene=SurfaceFacts(**_surface(scene.mesh, len(scene.splats), unit)),
        objects=[_object_facts(item, scene.world, (errors or {}).get(item.id)) for item in scene.objects],
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


def _world_facts(scene: Scene) -> WorldFacts:
    world = scene.world
    x, y, z, last = world.level_from_world.tolist()
    return WorldFacts(
        up=tuple(world.up.tolist()),
        floor=float(world.floor),
        confidence=world.confidence,
        level_from_world=(tuple(x), tuple(y), tuple(z), tuple(last)),
    )


def _object_facts(item: SceneObject, world: World, error: DepthError | None) -> ObjectFacts:
    seen, units_per_metre = item.observed, world.units_per_metre
    mesh, splats = None if seen is None else seen.mesh, 0 if item.splats is None else len(item.splats)
    return ObjectFacts(
        id=item.id,
        label=item.name,
        observed_share=round(float(seen.observed.mean()), 4) if seen is not None and len(seen.observed) else 0.0,
        completion=None if item.solid is None else _completion_facts(item.solid, item.completed, units_per_metre),
        depth_error=None if error is None else _depth_error_facts(error, units_per_metre),
        contact=None if item.contact is None else _contact_facts(item.contact, world),
        **_surface(mesh, splats, units_per_metre),
    )


def _depth_error_facts(error: DepthError, units_per_metre: float) -> DepthErrorFacts:
    return DepthErrorFacts(
        median_m=round(error.median / units_per_metre, 5),
        mad_m=round(error.mad / units_per_metre, 5),
        pixels=error.pixels,
    )


def _contact_facts(contact: Contact, world: World) -> ContactFacts:
    height = (contact.plane.offset - world.floor) / world.units_per_metre
    return ContactFacts(on=list(contact.on), height_m=round(height, 4), confidence=contact.confidence)


def _completion_facts(solid: FlaggedMesh, how: Completed | None, units_per_metre: float) -> CompletionFacts:
    error = None if how is None else how.expected_error
    return CompletionFacts(
        vertices=len(solid.mesh.vertices),
        faces=len(solid.mesh.faces),
        completed_share=round(filled_share(solid), 4),
        watertight=is_watertight(solid.mesh),
        volume_m3=round(signed_volume(solid.mesh) / units_per_metre**3, 9),
        area_m2=round(float(face_areas(solid.mesh).sum()) / units_per_metre**2, 4),
        method=None if how is None else how.method,
        expected_error_m=None if error is None else round(error / units_per_metre, 5),
        trusted=None if how is None else how.trusted,
    )


def filled_share(surface: FlaggedMesh) -> float:
    """Share of a surface's area that was not measured; each face counts by the share of its corners not observed."""
    areas = face_areas(surface.mesh)
    filled = 1.0 - surface.observed[surface.mesh.faces].mean(axis=1)
    return float((areas * filled).sum() / max(float(areas.sum()), 1e-30))


def _surface(mesh: Mesh | None, splats: int, units_per_metre: float) -> dict[str, Any]:
    bounds = None
    size = (0.0, 0.0, 0.0)
    if mesh is not None and len(mesh.vertices):
        low, high = mesh.vertices.min(0).tolist(), mesh.vertices.max(0).tolist()
        bounds = (tuple(low), tuple(high))
        size = tuple(round((b - a) / units_per_metre, 4) for a, b in zip(low, high, strict=True))
    return {
        "vertices": 0 if mesh is None else len(mesh.vertices),
        "faces": 0 if mesh is None else len(mesh.faces),
        "splats": splats,
        "bounds": bounds,
        "size_m": size,
        "area_m2": 0.0 if mesh is None else round(float(face_areas(mesh).sum()) / units_per_metre**2, 4),
    }
