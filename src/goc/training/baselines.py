"""The methods that `goc osc eval` compares; all but `network alone` compose as `goc carve` does."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy import ndimage

from goc.complete import (
    Completer,
    Measured,
    QueryGrid,
    Refinement,
    bounding_cube,
    closed_surface,
    compose,
    compose_field,
    decode,
    model_fill,
    partial_object,
    signed_distance,
    with_margin,
)
from goc.complete.candidates import (
    ALL,
    CONVEX,
    HULL,
    MIRRORED_NETWORK,
    NETWORK,
    Candidate,
    Filler,
    candidates,
    coarsened,
    hypotheses,
)
from goc.complete.choice import choose_for, read_calibration
from goc.complete.compose import Composition
from goc.complete.convex import nothing_fill
from goc.complete.hull import BAND
from goc.complete.poisson import poisson_fill
from goc.geometry.isosurface import grid_surface
from goc.geometry.surfaces import surface_cloud, vertex_normals
from goc.scene import Evidence, Mesh
from goc.training.masking import MaskedObject
from goc.training.samples import true_distance

Grid = Float32[np.ndarray, "x y z"]

_INSTEAD = {MIRRORED_NETWORK: NETWORK}
"""What stands in for a candidate that does not apply; for all others, the convex hull does."""
POISSON, CHOICE = "screened Poisson", "choice"
__all__ = ["CHOICE", "HULL", "NETWORK", "POISSON", "Completion", "completions", "measured_object"]

_COARSE = 64
_POISSON_POINTS = 30_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Completion:
    """One method's completion of one object, in the frame of its cube."""

    mesh: Mesh
    distance: Grid
    """Signed distance in voxels, positive outside. The mesh is its zero level, except for the method `nothing`, where
    that is the border of the measured band."""
    origin: Float[np.ndarray, "3"]
    """Position of distance[0, 0, 0], frame of the cube."""
    voxel: float
    seconds: float
    """From evidence to mesh."""

    def inside(self, points: Float32[np.ndarray, "p 3"]) -> Bool[np.ndarray, "p"]:
        """Which points lie inside: the distance interpolated trilinearly, outside beyond the grid."""
        at = ((points - self.origin) / self.voxel).T
        return ndimage.map_coordinates(self.distance, at, order=1, mode="constant", cval=BAND) < 0


def measured_object(masked: MaskedObject) -> Measured | None:
    """A masked object as extraction hands it to completion: its open measured mesh, and its evidence; cube's frame.

    Returns:
        None where no whole face was measured.
    """
    evidence = masked.partial.evidence
    near = (evidence.state == Evidence.SURFACE) & (np.abs(evidence.sdf) < evidence.voxel)
    places = (evidence.origin + evidence.voxel * np.argwhere(near)).astype(np.float32)
    if len(places) == 0:
        return None
    points = Mesh(vertices=places, faces=np.zeros((0, 3), np.int32))
    hull = compose(Measured(mesh=points, evidence=evidence), None)
    faces = hull.mesh.faces[hull.observed[hull.mesh.faces].all(axis=1)]
    if len(faces) == 0:
        return None
    used, place = np.unique(faces, return_inverse=True)
    mesh = Mesh(vertices=hull.mesh.vertices[used], faces=place.reshape(-1, 3).astype(np.int32))
    return Measured(mesh=mesh, evidence=evidence)


def completions(
    found: Measured, masked: MaskedObject, network: Completer | None, threshold: float
) -> Iterator[tuple[str, Completion]]:
    """Completions of one object by name of method. The last is given the truth: a bound for what any could reach."""
    yield "nothing", replace(_composed(found, nothing_fill), mesh=found.mesh, seconds=0.0)
    yield POISSON, _composed(found, _poisson)
    if network is not None:
        yield "network alone", _alone(found, network, threshold)
    options = {option.name: (option, seconds) for option, seconds in _timed(found, network, threshold)}
    for name in ALL if network is not None else (name for name in ALL if "network" not in name):
        instead = next(other for other in (name, _INSTEAD.get(name, CONVEX), HULL) if other in options)
        option, seconds = options[instead]
        yield name, _completion(option.composed, found, seconds)
    if network is not None:
        yield CHOICE, _chosen(found, _asking(network, threshold))
    yield "perfect guess", _composed(found, lambda seen: _true(seen, masked))


def _timed(found: Measured, network: Completer | None, threshold: float) -> Iterator[tuple[Candidate, float]]:
    """All candidates that apply, and the seconds that each took."""
    started = time.perf_counter()
    ask = None if network is None else _asking(network, threshold)
    for option in candidates(found, hypotheses(coarsened(found)), ask):
        yield option, time.perf_counter() - started
        started = time.perf_counter()


def _asking(network: Completer, threshold: float) -> Filler:
    return lambda seen, at: model_fill(network, seen, vertex_normals(seen.mesh), threshold, _COARSE, at)


def _chosen(found: Measured, ask: Filler) -> Completion:
    started = time.perf_counter()
    fill, _ = choose_for(found, ask, read_calibration())
    composed = compose_field(with_margin(found.evidence), fill, found.mesh.vertices)
    return _completion(composed, found, time.perf_counter() - started)


def _composed(found: Measured, fill: Callable[[Measured], Grid | None]) -> Completion:
    started = time.perf_counter()
    composed = compose_field(with_margin(found.evidence), fill(found), found.mesh.vertices)
    return _completion(composed, found, time.perf_counter() - started)


def _completion(composed: Composition, found: Measured, seconds: float) -> Completion:
    started = time.perf_counter()
    mesh = closed_surface(composed, found.mesh).mesh
    seconds += time.perf_counter() - started
    grid = composed.evidence
    return Completion(mesh=mesh, distance=composed.distance, origin=grid.origin, voxel=grid.voxel, seconds=seconds)


def _alone(found: Measured, network: Completer, threshold: float) -> Completion:
    """A network's answer in its whole cube, without regard to what was measured."""
    started = time.perf_counter()
    points = found.mesh.vertices
    cube = bounding_cube(points)
    field = network.complete(partial_object(points, vertex_normals(found.mesh), found.evidence, cube))
    count = math.ceil(cube.side / found.evidence.voxel)
    queries = QueryGrid(origin=np.full(3, 1.0 / count - 1.0), voxel=2.0 / count, shape=(count,) * 3)
    distance = signed_distance(decode(field, queries, Refinement(cells=_COARSE)), threshold)
    origin, voxel = cube.centre + queries.origin * (cube.side / 2), cube.side / count
    vertices, faces = grid_surface(distance, origin, voxel)
    seconds = time.perf_counter() - started
    mesh = Mesh(vertices=vertices, faces=faces)
    return Completion(mesh=mesh, distance=distance, origin=origin, voxel=voxel, seconds=seconds)


def _poisson(found: Measured) -> Grid:
    cloud = surface_cloud(found.mesh, _POISSON_POINTS)
    assert cloud.normals is not None
    return poisson_fill(cloud.positions, cloud.normals, with_margin(found.evidence))


def _true(found: Measured, masked: MaskedObject) -> Grid:
    grid = with_margin(found.evidence)
    points = (grid.origin + grid.voxel * np.argwhere(np.ones(grid.state.shape, bool))).astype(np.float32)
    return (true_distance(masked, points) / np.float32(grid.voxel)).reshape(grid.state.shape)
