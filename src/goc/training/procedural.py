"""Procedural training shapes, which need no data: CSG of primitives, extrusions, lathes, shells, furniture."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from goc.training.furniture import FURNITURE
from goc.training.primitives import Box, Cylinder, Ellipsoid, Lathe, Primitive, Prism, Shrunk, Torus, Tube
from goc.training.watertight_shape import CsgPart, WatertightShape, shape_from_parts

Random = np.random.Generator

THINNEST = 0.018
"""Least thickness of walls, in longest sides of the shape: a grid cannot hold thinner ones."""


def random_shape(random: Random, cells: int = 96) -> WatertightShape:
    """A random shape whose longest side is `cells` voxels; the same for the same state of `random`."""
    while True:
        kind = random.choice(len(_KINDS), p=_SHARES)
        solid = shape_from_parts(_KINDS[kind](random), cells)
        if solid is not None:
            return solid


def _csg(random: Random) -> list[CsgPart]:
    """Two to seven bodies joined, some of them cut out."""
    tilted = random.random() < 0.4
    parts = [CsgPart(body=_body(random, 1.0), at=(0.0, 0.0, 0.0), turn=_turn(random, tilted))]
    for _ in range(random.integers(1, 7)):
        host = parts[random.integers(len(parts))]
        at = np.array(host.at) + random.uniform(-0.9, 0.9, 3) * host.body.half_extent()
        body, turn = _body(random, random.uniform(0.25, 0.9)), _turn(random, tilted)
        if random.random() < 0.3:
            parts.append(CsgPart(body=body, at=tuple(at), turn=turn, operation="difference"))
        else:
            blend = float(random.uniform(0.02, 0.2)) if random.random() < 0.25 else 0.0
            parts.append(CsgPart(body=body, at=tuple(at), turn=turn, blend=blend))
    return parts


def _body(random: Random, size: float) -> Primitive:
    sides = size * random.uniform(0.15, 1.0, 3)
    match random.integers(6):
        case 0 | 1:
            return Box(tuple(sides), float(random.choice([0.0, 0.1, 0.4]) * sides.min() / 2))
        case 2:
            return Ellipsoid(tuple(sides / 2))
        case 3:
            return Cylinder(sides[0] / 2, sides[2], float(random.choice([0.0, 0.2]) * sides.min() / 2))
        case 4:
            return Torus(sides[0] / 2, max(0.3 * sides[1] / 2, 0.03))
        case _:
            return Prism(_outline(random, sides[0], sides[1]), sides[2])


def _turn(random: Random, tilted: bool) -> Float[np.ndarray, "3 3"] | None:
    if tilted:
        return Rotation.random(random_state=np.random.RandomState(random.integers(2**31))).as_matrix()  # noqa: NPY002
    return None if random.random() < 0.6 else _about_z(random.uniform(0, 2 * np.pi))


def _about_z(angle: float) -> Float[np.ndarray, "3 3"]:
    return Rotation.from_euler("z", angle).as_matrix()


def _outline(random: Random, width: float, depth: float) -> Float[np.ndarray, "k 2"]:
    """A star-shaped polygon: regular, L, U, cross, or uneven."""
    match random.integers(4):
        case 0:
            angles = np.arange(random.integers(3, 9)) * 2 * np.pi
            corners = np.stack([np.cos(angles / len(angles)), np.sin(angles / len(angles))], -1)
        case 1:
            a, b = random.uniform(-0.5, 0.5, 2)
            corners = np.array([[-1, -1], [1, -1], [1, a], [b, a], [b, 1], [-1, 1.0]])
        case 2:
            a, b = random.uniform(0.2, 0.7, 2)
            corners = np.array([[-1, -1], [1, -1], [1, 1], [a, 1], [a, b - 1], [-a, b - 1], [-a, 1], [-1, 1.0]])
        case _:
            count = random.integers(5, 10)
            angles = (np.arange(count) + random.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
            reach = random.uniform(0.4, 1.0, count)
            corners = np.stack([reach * np.cos(angles), reach * np.sin(angles)], -1)
    return corners * [width / 2, depth / 2]


def _extrusion(random: Random) -> list[CsgPart]:
    """A profile drawn out, lying or standing, often with holes or a cavity."""
    width, depth, height = random.uniform(0.2, 1.0, 3)
    outline = _outline(random, width, depth)
    turn = Rotation.from_euler("xyz", random.integers(0, 4, 3) * np.pi / 2).as_matrix()
    parts = [CsgPart(body=Prism(outline, height), at=(0, 0, 0), turn=turn)]
    if random.random() < 0.4:  # hollow, open at one end
        inner = outline * random.uniform(0.6, 0.85)
        shift = turn @ np.array([0, 0, random.uniform(0.05, 0.3) * height])
        parts.append(CsgPart(body=Prism(inner, height), at=tuple(shift), turn=turn, operation="difference"))
    for _ in range(random.integers(0, 3)):
        bore = Cylinder(random.uniform(0.03, 0.15), 3.0)
        at = turn @ np.array([*random.uniform(-0.3, 0.3, 2) * [width, depth], 0])
        parts.append(CsgPart(body=bore, at=tuple(at), turn=turn, operation="difference"))
    return parts


def _lathe(random: Random) -> list[CsgPart]:
    """Something turned: massive, or a vessel with a wall and an opening."""
    count = random.integers(3, 7)
    radii = random.uniform(0.1, 0.5, count)
    if random.random() < 0.5:
        radii = np.sort(radii)
    heights = np.sort(random.uniform(0, 1, count)) * random.uniform(0.3, 1.4)
    heights -= heights[0]
    line = np.stack([radii, heights + np.arange(count) * 0.02], -1)
    middle = line[-1, 1] / 2
    outer = np.concatenate([[[0, 0]], line, [[0, line[-1, 1]]]]) - [0, middle]
    at, turn = (0.0, 0.0, 0.0), None
    parts = [CsgPart(body=Lathe(outer), at=at, turn=turn)]
    wall = random.uniform(THINNEST * 1.2, 0.08) * max(line[-1, 1], 2 * radii.max())
    if random.random() < 0.3:
        handle = Torus(random.uniform(0.12, 0.25), random.uniform(0.02, 0.05))
        upright = Rotation.from_euler("x", np.pi / 2).as_matrix()
        place = (float(np.interp(middle, line[:, 1], line[:, 0])), 0.0, 0.0)
        parts.append(CsgPart(body=handle, at=place, turn=upright))
    if random.random() < 0.7:  # the wall is even: the same profile, drawn on upwards, moved inwards
        drawn_on = np.concatenate([outer[:-1], [[line[-1, 0], middle + 1.0], [0, middle + 1.0]]])
        parts.append(CsgPart(body=Shrunk(Lathe(drawn_on), wall), at=at, turn=turn, operation="difference"))
    return parts


def _shell(random: Random) -> list[CsgPart]:
    """A box or round vessel with thick or thin walls, open on one side, maybe with shelves or walls inside."""
    sides = random.uniform(0.3, 1.0, 3)
    wall = random.uniform(THINNEST * 1.2, 0.12) * sides.max()
    inner = sides - 2 * wall
    if (inner < 0.1).any():
        inner = np.maximum(inner, 0.1)
    axis, way = random.integers(3), random.choice([-1, 1])
    shift = np.zeros(3)
    shift[axis] = way * wall * 1.5
    inner[axis] += wall
    round_ = random.random() < 0.25
    outer = Cylinder(sides[0] / 2, sides[2]) if round_ else Box(tuple(sides), random.uniform(0, 0.3) * wall)
    hollow = Cylinder(max(sides[0] / 2 - wall, 0.05), inner[2]) if round_ else Box(tuple(inner))
    if round_:
        shift = np.array([0, 0, way * wall * 1.5])
        hollow = Cylinder(max(sides[0] / 2 - wall, 0.05), sides[2] - wall)
    parts = [CsgPart(body=outer, at=(0, 0, 0)), CsgPart(body=hollow, at=tuple(shift), operation="difference")]
    for _ in range(random.integers(0, 4)):
        across = random.integers(3)
        plate = inner.copy()
        plate[across] = max(wall, THINNEST * sides.max())
        at = shift.copy()
        at[across] += random.uniform(-0.35, 0.35) * sides[across]
        if not round_ and abs(at[across]) < sides[across] / 2 - wall:
            plate = np.minimum(plate, sides)
            parts.append(
                CsgPart(body=Box(tuple(plate)), at=tuple(np.clip(at, -(sides - plate) / 2, (sides - plate) / 2)))
            )
    return parts


def _blob(random: Random) -> list[CsgPart]:
    """Round bodies grown together: toys, fruit, plush, plants."""
    parts: list[CsgPart] = []
    at = np.zeros(3)
    for _ in range(random.integers(2, 8)):
        body = Ellipsoid(tuple(random.uniform(0.1, 0.4, 3)))
        parts.append(CsgPart(body=body, at=tuple(at), turn=_turn(random, True), blend=float(random.uniform(0.03, 0.2))))
        at = at + random.normal(0, 0.2, 3)
    if random.random() < 0.3:
        parts.append(CsgPart(body=Box((3, 3, 3)), at=(0, 0, 1.5 - random.uniform(0, 0.2)), operation="intersection"))
    return parts


def _wire(random: Random) -> list[CsgPart]:
    """Bars along bent lines, sometimes with a body on them."""
    parts = []
    for _ in range(random.integers(1, 5)):
        steps = random.normal(0, 0.3, (random.integers(2, 6), 3))
        line = np.cumsum(steps, 0)
        parts.append(CsgPart(body=Tube(line - line.mean(0), random.uniform(0.02, 0.08)), at=(0, 0, 0)))
    if random.random() < 0.6:
        parts.append(CsgPart(body=_body(random, 0.6), at=tuple(random.uniform(-0.2, 0.2, 3))))
    return parts


def _furniture(random: Random) -> list[CsgPart]:
    return FURNITURE[random.integers(len(FURNITURE))](random)


_KINDS = (_csg, _extrusion, _lathe, _shell, _blob, _wire, _furniture)
_SHARES = (0.16, 0.09, 0.13, 0.12, 0.07, 0.03, 0.4)
