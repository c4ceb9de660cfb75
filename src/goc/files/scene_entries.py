"""The schema of scene.json: all of a scene except meshes, splats and grids, which have their own files."""

from typing import Annotated, Any

import msgspec
import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from goc import __version__
from goc.scene import Camera, Completed, Contact, HalfSpace, Scene, SceneObject, World

VERSION = 1
"""Version of scene.json and the files that it lists. Raise it whenever an older goc would misread them."""

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]
"""Rows of a matrix that maps columns (x, y, z, 1)."""
_Positive = Annotated[float, msgspec.Meta(gt=0.0)]
_Count = Annotated[int, msgspec.Meta(ge=1)]


class WorldEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`World`, with the transform that follows from it."""

    up: Vector
    """Unit vector in the world of the capture."""
    floor: float
    confidence: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
    units_per_metre: _Positive
    metric: bool
    level_from_world: Matrix
    """From the capture's world to metres, right-handed, z up, floor at z = 0. It follows from the other fields."""
    offset: Vector = (0.0, 0.0, 0.0)
    """Positions in the capture's files are those of the capture's world here plus this."""


class CameraEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`Camera` of one view: x right, y down, z forward; pixel (0, 0) is centred at (0.5, 0.5)."""

    name: str
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    width: _Count
    height: _Count
    world_from_cam: Matrix


class PlaneEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`HalfSpace`: normal · x ≥ offset, in the world of the capture."""

    normal: Vector
    offset: float


class ContactEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`Contact`."""

    on: list[Annotated[int, msgspec.Meta(ge=0)]]
    plane: PlaneEntry
    confidence: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class CompletedEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`Completed`."""

    method: str
    expected_error: float | None
    trusted: bool


class ObjectEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One object; four fields say which of its parts have files."""

    id: _Count
    name: str
    world_from_object: Matrix
    observed: bool
    solid: bool
    splats: bool
    evidence: bool
    contact: ContactEntry | None = None
    walls: list[PlaneEntry] = []
    completed: CompletedEntry | None = None


class SceneEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of scene.json."""

    schema: int
    goc: str
    """Version of goc that wrote it."""
    world: WorldEntry
    objects: list[ObjectEntry]
    """Ascending ids."""
    cameras: list[CameraEntry]
    metrics: dict[str, float | None]
    """Figures of the reconstruction by name; null where one is not finite."""
    settings: dict[str, Any]
    """Every setting of the run that made the scene."""


def entry_of(scene: Scene) -> SceneEntry:
    """Convert a scene to the content of scene.json."""
    return SceneEntry(
        schema=VERSION,
        goc=__version__,
        world=WorldEntry(
            up=tuple(scene.world.up.tolist()),
            floor=float(scene.world.floor),
            confidence=float(scene.world.confidence),
            units_per_metre=float(scene.world.units_per_metre),
            metric=scene.world.metric,
            level_from_world=matrix_of(scene.world.level_from_world),
            offset=scene.world.offset,
        ),
        objects=[_object_entry(item) for item in scene.objects],
        cameras=[_camera_entry(name, camera) for name, camera in scene.cameras.items()],
        metrics={name: float(value) for name, value in scene.metrics.items()},
        settings=scene.settings,
    )


def matrix_of(matrix: Float64[np.ndarray, "4 4"] | Float[Tensor, "4 4"]) -> Matrix:
    """Convert a matrix to rows of numbers."""
    return tuple(tuple(float(value) for value in row) for row in matrix.tolist())


def world_of(entry: WorldEntry) -> World:
    """Convert an entry of scene.json to a world."""
    return World(
        up=np.array(entry.up, np.float64),
        floor=entry.floor,
        confidence=entry.confidence,
        units_per_metre=entry.units_per_metre,
        metric=entry.metric,
        offset=entry.offset,
    )


def camera_of(entry: CameraEntry) -> Camera:
    """Convert an entry of scene.json to a camera in float32."""
    return Camera(
        focal_px=torch.tensor(entry.focal_px, dtype=torch.float32),
        centre_px=torch.tensor(entry.centre_px, dtype=torch.float32),
        width=entry.width,
        height=entry.height,
        world_from_cam=torch.tensor(entry.world_from_cam, dtype=torch.float32),
    )


def _object_entry(item: SceneObject) -> ObjectEntry:
    return ObjectEntry(
        id=item.id,
        name=item.name,
        world_from_object=matrix_of(item.world_from_object),
        observed=item.observed is not None,
        solid=item.solid is not None,
        splats=item.splats is not None,
        evidence=item.evidence is not None,
        contact=None if item.contact is None else _contact_entry(item.contact),
        walls=[_plane_entry(plane) for plane in item.walls],
        completed=None if item.completed is None else CompletedEntry(**vars(item.completed)),
    )


def completed_of(entry: CompletedEntry) -> Completed:
    """Convert an entry of scene.json to how an object was closed."""
    return Completed(method=entry.method, expected_error=entry.expected_error, trusted=entry.trusted)


def contact_of(entry: ContactEntry) -> Contact:
    """Convert an entry of scene.json to a contact."""
    return Contact(on=tuple(entry.on), plane=plane_of(entry.plane), confidence=entry.confidence)


def plane_of(entry: PlaneEntry) -> HalfSpace:
    """Convert an entry of scene.json to the side of a plane."""
    return HalfSpace(normal=np.array(entry.normal, np.float64), offset=entry.offset)


def _contact_entry(contact: Contact) -> ContactEntry:
    return ContactEntry(on=list(contact.on), plane=_plane_entry(contact.plane), confidence=contact.confidence)


def _plane_entry(plane: HalfSpace) -> PlaneEntry:
    x, y, z = plane.normal.tolist()
    return PlaneEntry(normal=(x, y, z), offset=plane.offset)


def _camera_entry(name: str, camera: Camera) -> CameraEntry:
    return CameraEntry(
        name=name,
        focal_px=tuple(camera.focal_px.tolist()),
        centre_px=tuple(camera.centre_px.tolist()),
        width=camera.width,
        height=camera.height,
        world_from_cam=matrix_of(camera.world_from_cam),
    )
