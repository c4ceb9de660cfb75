"""The support graph: who stands on whom, and at which height, from the upward surface seen round each footprint."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from goc.complete.room_planes import RoomSurface, room_surface, wall_planes, walls_of
from goc.scene import ROOM, Contact, Evidence, EvidenceGrid, HalfSpace, Mesh, SceneObject, World

_LEVEL = np.cos(np.radians(20.0))
"""Least cosine between up and the normal of a face that can bear something."""
_RING = (0.01, 0.06)
"""Distances from the footprint between which the supporter's surface is read, metres: nearer, both are blurred."""
_SLAB = (0.02, 0.15)
"""The footprint is the outline of what was measured this far above the lowest points: metres, and share of height."""
_STRAY = 0.03
"""Largest share of an object's measured points below its contact: noise."""
_LOWEST = 0.002
"""Quantile of the heights that counts as the lowest measured point."""
_LAYER = 0.005
"""Surface within this of a level belongs to it, metres."""
_GAP = (0.03, 0.2)
"""The lowest measured point is at most this far above the contact: metres, or share of the object's height."""
_DOUBT = 0.02
"""Gap between contact and lowest measured point that halves the confidence, metres."""
_BLURRED = 4.0
"""Voxels above a supporter in which rays that end on it tell."""
_SECTORS = 16
_LEAST_COVER = 0.12
"""Share of the sectors round the footprint in which a supporter is seen at the height of the contact."""
_SURE_WORLD = 0.5
"""Confidence from which on the world's floor is believed where no floor was seen round a footprint."""
_UNSEEN_FLOOR = 0.25
"""Cover that such a floor counts with."""


@dataclass(frozen=True, eq=False)
class _Body:
    """What contacts need of an object, in the level frame: metres, z up."""

    points: Float64[np.ndarray, "v 3"]
    tops: Float64[np.ndarray, "t 3"]
    low: float
    height: float
    foot: Float64[np.ndarray, "n 3"]
    """Its lowest measured points, without strays."""


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A level near an object's footprint."""

    of: int
    height: float
    cover: float
    score: float


def with_contacts(objects: tuple[SceneObject, ...], mesh: Mesh, world: World) -> tuple[SceneObject, ...]:
    """The objects, each with what bears it and with the walls that it stands before.

    A contact is the highest level that is seen 1 to 6 cm round the footprint, on another object or on the room, and
    that the object's lowest measured points agree with. Where nothing of the kind is seen, but the lowest points are
    just above the floor of a world that is sure of it, the floor bears. Else nothing does: it hangs, or is held.

    Args:
        objects: with their measured surface; those without one get no contact.
        mesh: surface of the whole scene, faces counter-clockwise seen from the cameras.
        world: up, floor and unit.
    """
    level = world.level_from_world
    seen = {item.id: item for item in objects if item.observed is not None and len(item.observed.mesh.faces)}
    if not seen:
        return objects
    clouds = [item.observed.mesh.vertices for item in seen.values() if item.observed is not None]
    room = room_surface(mesh, np.concatenate(clouds), level)
    bodies = {id: _body(item, level) for id, item in seen.items()}
    tops = {ROOM: room.points[room.normals[:, 2] >= _LEVEL]} | {id: body.tops for id, body in bodies.items()}
    floor = 0.0 if world.confidence >= _SURE_WORLD else None
    planes = wall_planes(room)
    return tuple(
        replace(
            item,
            contact=_contact(item, bodies, tops, floor, world) if item.id in bodies else None,
            walls=_in_world(walls_of(bodies[item.id].points, planes, room), world) if item.id in bodies else (),
        )
        for item in objects
    )


def _in_world(planes: Sequence[HalfSpace], world: World) -> tuple[HalfSpace, ...]:
    """Planes of the level frame in the capture's world and unit."""
    turn, shift = world.level_from_world[:3, :3] * world.units_per_metre, world.level_from_world[:3, 3]
    return tuple(
        HalfSpace(normal=plane.normal @ turn, offset=float(plane.offset - plane.normal @ shift) * world.units_per_metre)
        for plane in planes
    )


def _body(item: SceneObject, level: Float64[np.ndarray, "4 4"]) -> _Body:
    assert item.observed is not None
    mesh = item.observed.mesh
    surface = RoomSurface.of(mesh, level)
    points = mesh.vertices.astype(np.float64) @ level[:3, :3].T + level[:3, 3]
    low, high = np.quantile(points[:, 2], [_LOWEST, 1 - _LOWEST]).tolist()
    above = points[:, 2] - low
    foot = points[(above >= 0) & (above <= max(_SLAB[0], _SLAB[1] * (high - low)))]
    return _Body(
        points=points,
        tops=surface.points[surface.normals[:, 2] >= _LEVEL],
        low=low,
        height=high - low,
        foot=foot if len(foot) else points[points[:, 2].argmin()][None],
    )


def _contact(
    item: SceneObject,
    bodies: Mapping[int, _Body],
    tops: Mapping[int, Float64[np.ndarray, "t 3"]],
    floor: float | None,
    world: World,
) -> Contact | None:
    """What bears one object."""
    body = bodies[item.id]
    tree = cKDTree(body.foot[:, :2])
    found = [
        candidate
        for of, points in tops.items()
        if of != item.id
        for candidate in _levels(of, _ring(points, body, tree), body)
        if of == ROOM or candidate.height > bodies[of].low + _LAYER / 2
    ]
    if floor is not None and not any(candidate.of == ROOM for candidate in found):
        found.append(_Candidate(ROOM, floor, _UNSEEN_FLOOR, _score(_UNSEEN_FLOOR, floor, body)))
    found = [candidate for candidate in found if candidate.score > 0 and not _hovers(item, body, candidate, world)]
    if not found:
        return None
    best = max(found, key=lambda candidate: (candidate.score, candidate.height))
    same = [candidate for candidate in found if abs(candidate.height - best.height) <= _LAYER]
    weights = np.array([candidate.cover for candidate in same])
    height = float(np.average([candidate.height for candidate in same], weights=weights))
    on = tuple(sorted({candidate.of for candidate in same}))
    plane = _in_world([HalfSpace(normal=np.array([0.0, 0, 1]), offset=height)], world)[0]
    return Contact(on=on, plane=plane, confidence=round(min(1.0, best.score), 3))


def _ring(tops: Float64[np.ndarray, "t 3"], body: _Body, tree: cKDTree) -> Float64[np.ndarray, "r 3"]:
    """The upward surface between the two distances from a footprint, no higher than the object's lowest half."""
    low, high = body.foot[:, :2].min(axis=0) - _RING[1], body.foot[:, :2].max(axis=0) + _RING[1]
    near = tops[((tops[:, :2] >= low) & (tops[:, :2] <= high)).all(axis=1)]
    reach = max(_GAP[0], _GAP[1] * body.height)
    near = near[(near[:, 2] > body.low - reach - _LAYER) & (near[:, 2] < body.low + body.height / 2)]
    if not len(near):
        return near
    away = tree.query(near[:, :2], distance_upper_bound=_RING[1])[0]
    return near[(away >= _RING[0]) & (away <= _RING[1])]


def _levels(of: int, ring: Float64[np.ndarray, "r 3"], body: _Body) -> list[_Candidate]:
    """Heights at which a ring has a layer of surface, with how much of the round each covers."""
    found: list[_Candidate] = []
    centre = body.foot[:, :2].mean(axis=0)
    left = ring
    while len(left):
        counts, edges = np.histogram(left[:, 2], np.arange(left[:, 2].min(), left[:, 2].max() + 3 * _LAYER, _LAYER))
        at = int((counts[:-1] + counts[1:]).argmax()) if len(counts) > 1 else 0
        middle = float(edges[at + 1])
        layer = np.abs(left[:, 2] - middle) <= 1.5 * _LAYER
        height = float(np.median(left[layer, 2]))
        turn = np.arctan2(left[layer, 1] - centre[1], left[layer, 0] - centre[0])
        cover = len(np.unique(np.floor(turn / (2 * np.pi) * _SECTORS).astype(int) % _SECTORS)) / _SECTORS
        if cover >= _LEAST_COVER:
            found.append(_Candidate(of, height, cover, _score(cover, height, body)))
        left = left[~layer & (left[:, 2] > middle - 1.5 * _LAYER)] if cover >= _LEAST_COVER else left[~layer]
    return found


def _score(cover: float, height: float, body: _Body) -> float:
    """How well a level bears an object, 0…1: 0 where too much of the object is below it or all is too far above."""
    gap = max(0.0, body.low - height)
    if gap > max(_GAP[0], _GAP[1] * body.height):
        return 0.0
    below = float((body.points[:, 2] < height - _LAYER).mean())
    return cover * max(0.0, 1 - below / _STRAY) / (1 + gap / _DOUBT)


def _hovers(item: SceneObject, body: _Body, candidate: _Candidate, world: World) -> bool:
    """Rays passed between the object's lowest points and a level: it does not stand there.

    Just above the level, voxels count as empty because rays ended on the supporter: that says nothing of the object.
    """
    grid = item.evidence
    if grid is None:
        return False
    bottom, top = candidate.height + _BLURRED * grid.voxel / world.units_per_metre, body.low - _LAYER
    if top <= bottom:
        return False
    lowest = body.foot[body.foot[:, 2] <= body.low + _LAYER]
    between = np.linspace(bottom, top, 5)
    columns = np.repeat(lowest, len(between), axis=0)
    columns[:, 2] = np.tile(between, len(lowest))
    back = np.linalg.inv(world.level_from_world)
    return float(_seen_empty(columns @ back[:3, :3].T + back[:3, 3], grid).mean()) > 0.5


def _seen_empty(points: Float64[np.ndarray, "p 3"], grid: EvidenceGrid) -> Bool[np.ndarray, "p"]:
    """Points that lie in voxels seen empty; those beyond the grid do not."""
    at = np.rint((points - grid.origin) / grid.voxel).astype(np.int64)
    inside = ((at >= 0) & (at < np.array(grid.state.shape))).all(axis=1)
    empty = np.zeros(len(points), bool)
    empty[inside] = grid.state[tuple(at[inside].T)] == Evidence.EMPTY
    return empty
