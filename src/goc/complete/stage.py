"""Stage 4: measured, open objects in, closed ones out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32

from goc.complete.bounds import Bounds, bounded, bounds_of, cut, without_strays
from goc.complete.choice import Calibration, choose_for, read_calibration
from goc.complete.compose import Composition, Measured, compose_field, with_margin
from goc.complete.config import CompleteConfig
from goc.complete.contacts import with_contacts
from goc.complete.decode import QueryGrid, Refinement, decode, signed_distance
from goc.complete.finish import finished_surface
from goc.complete.lite import OscLite
from goc.complete.osc import Osc
from goc.complete.partial import Completer, Cube, bounding_cube, partial_object
from goc.complete.weights import SHIPPED, load_network
from goc.device import CPU
from goc.errors import CompleteError
from goc.events import Listener, Progress, Warned, ignore
from goc.geometry.surfaces import vertex_normals
from goc.geometry.topology import watertight_flaw
from goc.scene import Completed, Evidence, EvidenceGrid, Scene, SceneObject

_SEAM_VOXELS = 4
"""A model is asked this far into the measured surface, so that both can be compared where they meet."""
_ENOUGH_CELLS = 120
"""Cells along the longest side at which a model is asked: its labels were no sharper than 1/128 of its cube."""
_BAND = 3.0 / 128.0
"""Greatest half width of the measured band that networks met in training, longest sides of the grid."""


def complete_objects(
    scene: Scene, config: CompleteConfig, notify: Listener = ignore, device: torch.device = CPU
) -> Scene:
    """The scene with its contacts found, and its objects closed as far as they can be: see `close_objects`."""
    objects, unit = with_contacts(scene.objects, scene.mesh, scene.world), scene.world.units_per_metre
    return replace(scene, objects=close_objects(objects, config, notify, device, unit))


def close_objects(
    objects: tuple[SceneObject, ...],
    config: CompleteConfig,
    notify: Listener = ignore,
    device: torch.device = CPU,
    units_per_metre: float = 1.0,
) -> tuple[SceneObject, ...]:
    """Close every object: measured surface stays, seen-empty stays empty, the rest is filled in (paper §5).

    Objects end at their contacts and at walls (docs/decisions/0038). Of the rest, small objects come first, and what
    they fill is empty for the others.

    Args:
        objects: open surfaces with their evidence, and with contacts and walls where they are known.
        config: what fills the unknown.
        notify: hears one Progress an object, and a warning for each that cannot be closed, or whose closed surface is
            expected to be further from the truth than the open one.
        device: where a network computes.
        units_per_metre: scene units in one metre, for the tolerance of simplification.

    Returns:
        The same objects in the order given, each with its watertight `solid` (checked: docs/decisions/0021). As they
        came are those that have no inside, or no measured surface or evidence; and all, if the method is none.

    Raises:
        CompleteError: the weights are missing or of another network, or a network's answers are not finite.
    """
    if config.method == "none":
        return objects
    model = None if config.method == "hull" else network_for(config.method, config.weights, device)
    calibration = read_calibration() if config.method == "best" else None
    closed, bounds = list(objects), bounds_of(objects)
    filled: list[Composition] = []
    for number, place in enumerate(small_first(objects), 1):
        item = objects[place]
        found, flaw = seen_part(item, bounds[item.id], filled), "its surface or its evidence is missing"
        if found is not None:
            composed, how = _composed(found, model, config, calibration, filled, bounds[item.id])
            solid = finished_surface(composed, found.mesh, config.faces, units_per_metre)
            flaw = watertight_flaw(solid.mesh)
            if flaw is None:
                closed[place] = replace(item, solid=solid, completed=how)
                filled.append(composed)
                if not how.trusted:
                    notify(Warned(stage="complete", message=_doubt(item)))
        if flaw is not None:
            message = f"Object {item.id} ({item.name}) cannot be closed: {flaw}. It has its measured surface only."
            notify(Warned(stage="complete", message=message))
        notify(Progress(stage="complete", done=number, total=len(objects)))
    return tuple(closed)


def without_neighbours(grid: EvidenceGrid, solids: Sequence[Composition]) -> EvidenceGrid:
    """The evidence with the unknown space that other objects fill marked as empty: two things are not in one place.

    Without this, a table's hull would hold what is inside the cups on it, which no ray sees either.
    """
    state = grid.state.copy()
    for solid in solids:
        other = solid.evidence
        rows = [
            np.rint((grid.origin[a] + grid.voxel * np.arange(n) - other.origin[a]) / other.voxel).astype(np.int64)
            for a, n in enumerate(state.shape)
        ]
        met = [np.flatnonzero((row >= 0) & (row < other.state.shape[a])) for a, row in enumerate(rows)]
        part = state[np.ix_(*met)]
        filled = solid.distance[np.ix_(*(row[hit] for row, hit in zip(rows, met, strict=True)))] < 0
        state[np.ix_(*met)] = np.where(filled & (part == Evidence.UNKNOWN), np.uint8(Evidence.EMPTY), part)
    return replace(grid, state=state)


def seen_part(item: SceneObject, bounds: Bounds, solids: Sequence[Composition]) -> Measured | None:
    """What completion starts from: what was measured within an object's bounds, where `solids` are not.

    None where its surface or its evidence is absent.
    """
    if item.observed is None or item.evidence is None:
        return None
    found = without_strays(Measured(mesh=item.observed.mesh, evidence=item.evidence), bounds)
    return replace(found, evidence=without_neighbours(found.evidence, solids))


def _doubt(item: SceneObject) -> str:
    return (
        f"Object {item.id} ({item.name}): no guess at what nobody saw of it is believable. It is closed as tightly as "
        "possible; views from its other sides would tell."
    )


def _composed(
    found: Measured,
    model: Completer | None,
    config: CompleteConfig,
    calibration: Calibration | None,
    solids: Sequence[Composition],
    bounds: Bounds,
) -> tuple[Composition, Completed]:
    """The signed field of one object within its bounds, where `solids` are already taken, and how it came about."""

    def ask(seen: Measured, at: EvidenceGrid) -> Float32[np.ndarray, "x y z"]:
        assert model is not None
        return model_fill(model, seen, vertex_normals(seen.mesh), config.threshold, config.coarse_cells, at)

    fill, how = None, Completed(method=config.method)
    if calibration is not None:
        fill, made = choose_for(found, ask, calibration)
        how = Completed(method=made.name, expected_error=made.expected_error, trusted=made.trusted)
    elif model is not None:
        fill = ask(found, found.evidence)
    evidence = with_margin(bounded(found.evidence, bounds))
    return cut(compose_field(evidence, fill, found.mesh.vertices), bounds, solids), how


def small_first(objects: Sequence[SceneObject]) -> list[int]:
    """Places of the objects by the volume of their boxes: of what nobody saw, the smaller of two is the surer owner."""
    spans = [_span(item) for item in objects]
    return sorted(range(len(objects)), key=lambda place: (float(np.prod(spans[place])), place))


def _span(item: SceneObject) -> Float32[np.ndarray, "3"]:
    if item.observed is None or not len(item.observed.mesh.vertices):
        return np.zeros(3, np.float32)
    return np.ptp(item.observed.mesh.vertices, axis=0)


def model_fill(
    model: Completer,
    found: Measured,
    normals: Float32[np.ndarray, "v 3"],
    threshold: float,
    coarse_cells: int,
    at: EvidenceGrid | None = None,
    cube: Cube | None = None,
) -> Float32[np.ndarray, "x y z"]:
    """What a model fills in, as `compose` takes it: its signed distance at the voxels of `with_margin(at)`.

    Args:
        model: asked once for a field.
        found: seen surface, as the vertices of its mesh, and evidence.
        normals: unit, at the vertices.
        threshold: occupancy at which the model's surface is.
        coarse_cells: cells along the longest side in which its field is asked at first.
        at: evidence of the same object in other voxels, at which the answer is wanted; None: that of `found`.
        cube: in which it is asked; None: round what was seen.
    """
    grid = with_margin(found.evidence if at is None else at)
    points = found.mesh.vertices
    cube = bounding_cube(points) if cube is None else cube
    seen = narrowed(found.evidence, _BAND * max(found.evidence.state.shape) * found.evidence.voxel)
    field = model.complete(partial_object(points, normals, seen, cube))
    scale = 2.0 / cube.side
    queries = QueryGrid(origin=(grid.origin - cube.centre) * scale, voxel=grid.voxel * scale, shape=grid.state.shape)
    unknown = grid.state == Evidence.UNKNOWN
    surface = (grid.state == Evidence.SURFACE) & (np.abs(grid.sdf) < grid.voxel)
    refinement = Refinement(cells=coarse_cells, enough=_ENOUGH_CELLS)
    logits = decode(field, queries, refinement, wanted=_near(unknown, _SEAM_VOXELS), forced=surface)
    return signed_distance(logits, threshold)


def narrowed(evidence: EvidenceGrid, band: float) -> EvidenceGrid:
    """The same evidence with a band of measured surface at most `band` wide on either side.

    What falls out of it in front was passed by the rays that ended on the surface; what falls out behind is unknown.
    """
    wide = (evidence.state == Evidence.SURFACE) & (np.abs(evidence.sdf) > band)
    beyond = np.where(evidence.sdf > 0, np.uint8(Evidence.EMPTY), np.uint8(Evidence.UNKNOWN))
    return EvidenceGrid(
        origin=evidence.origin,
        voxel=evidence.voxel,
        state=np.where(wide, beyond, evidence.state),
        sdf=np.where(wide, np.float32(0), evidence.sdf),
    )


def check_completion(config: CompleteConfig) -> None:
    """Refuse weights that cannot be used, before the work is done that they are for.

    Raises:
        CompleteError: the weights are missing, or of another network; or the calibration is of another goc.
    """
    if config.method in ("best", "lite", "osc"):
        network_for(config.method, config.weights)
    if config.method == "best":
        read_calibration()


def network_for(method: str, weights: Path | None, device: torch.device = CPU) -> Completer:
    """The network that a method names, from the weights given, or from those that goc ships, on a device.

    Raises:
        CompleteError: the weights are missing, or of the other network.
    """
    path = weights or SHIPPED
    network = load_network(path)
    if method != "best" and not isinstance(network, OscLite if method == "lite" else Osc):
        raise CompleteError(f"{path}: these are not weights of {method}. Choose the method that they were made for.")
    return network.to(device)


def _near(voxels: np.ndarray, reach: int) -> np.ndarray:
    """Voxels at most `reach` steps along each axis from a chosen one."""
    for axis in range(3):
        lines = np.moveaxis(voxels, axis, 0)
        wide = lines.copy()
        for step in range(1, min(reach, len(lines) - 1) + 1):
            wide[step:] |= lines[:-step]
            wide[:-step] |= lines[step:]
        voxels = np.moveaxis(wide, 0, axis)
    return voxels
