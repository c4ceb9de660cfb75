"""Assemblies that look like what stands in rooms: what is under a table, behind a sofa, inside a shelf."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from goc.training.primitives import Box, Cylinder, Lathe, Number, Shrunk, Torus, Triple, Tube
from goc.training.watertight_shape import CsgPart

Random = np.random.Generator
Maker = Callable[[Random], list[CsgPart]]


def _block(sides: Triple, at: Triple, radius: Number = 0.0) -> CsgPart:
    """A box that stands on z = at[2]."""
    sides = tuple(float(side) for side in sides)
    return CsgPart(body=Box(sides, min(radius, 0.45 * min(sides))), at=(at[0], at[1], at[2] + sides[2] / 2))


def _legs(random: Random, width: float, depth: float, height: float, longest: float) -> list[CsgPart]:
    """Four legs under a rectangle: square, round, tapered or splayed."""
    thick = random.uniform(0.025, 0.06) * longest
    inset = random.uniform(0.5, 1.5) * thick
    kind, splay = random.integers(3), random.uniform(0, 0.15) * (random.random() < 0.4)
    parts = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            x, y = sx * (width / 2 - inset), sy * (depth / 2 - inset)
            if kind == 0 and not splay:
                parts.append(_block((thick, thick, height), (x, y, 0)))
            elif kind == 1 and not splay:
                parts.append(CsgPart(body=Cylinder(thick / 2, height), at=(x, y, height / 2)))
            else:
                foot = np.array([x * (1 + splay), y * (1 + splay), thick / 2])
                line = np.stack([foot, [x, y, height]])
                parts.append(CsgPart(body=Tube(line, thick / 2), at=(0, 0, 0)))
    if random.random() < 0.25:  # stretchers
        z = random.uniform(0.1, 0.5) * height
        bar = max(0.6 * thick, 0.018 * longest)
        for sy in (-1, 1):
            parts.append(_block((width - 2 * inset, bar, bar), (0, sy * (depth / 2 - inset), z)))
        for sx in (-1, 1):
            parts.append(_block((bar, depth - 2 * inset, bar), (sx * (width / 2 - inset), 0, z)))
    return parts


def table(random: Random) -> list[CsgPart]:
    """Dining, coffee and side tables, desks: top and legs, pedestal or panels, maybe apron, shelf, drawers."""
    width, depth = random.uniform(0.5, 1.8), random.uniform(0.4, 1.0)
    height, thick = random.uniform(0.3, 1.0), 0.0
    longest = max(width, depth, height)
    thick = random.uniform(0.02, 0.06) * longest
    parts: list[CsgPart] = []
    round_ = random.random() < 0.25
    if round_:
        depth = width
        parts.append(CsgPart(body=Cylinder(width / 2, thick), at=(0, 0, height - thick / 2)))
    else:
        parts.append(_block((width, depth, thick), (0, 0, height - thick), random.choice([0, 0.3]) * thick))
    style = random.random()
    if style < 0.2 or (round_ and style < 0.6):
        base = random.uniform(0.3, 0.7) * min(width, depth)
        parts.append(CsgPart(body=Cylinder(random.uniform(0.03, 0.08) * longest, height), at=(0, 0, height / 2)))
        parts.append(CsgPart(body=Cylinder(base / 2, 0.03 * longest), at=(0, 0, 0.015 * longest)))
    elif style < 0.35 and not round_:
        panel = random.uniform(0.02, 0.05) * longest
        parts += [_block((panel, depth * 0.95, height), (sx * (width / 2 - panel), 0, 0)) for sx in (-1, 1)]
        if random.random() < 0.5:
            back = random.uniform(0.3, 1.0) * height
            parts.append(_block((width * 0.95, panel, back), (0, depth / 2 - panel, height - back)))
    else:
        inside = 0.68 if round_ else 1.0
        parts += _legs(random, width * inside, depth * inside, height, longest)
        if random.random() < 0.4 and not round_:
            apron = random.uniform(0.05, 0.15) * height
            parts.append(_block((width * 0.9, depth * 0.9, apron), (0, 0, height - thick - apron)))
            if random.random() < 0.5:
                cut = Box((width * 0.9 - 0.08 * longest, depth * 0.9 - 0.08 * longest, 2 * apron))
                parts.append(CsgPart(body=cut, at=(0, 0, height - thick - apron), operation="difference"))
                parts.append(_block((width, depth, thick), (0, 0, height - thick)))
    if random.random() < 0.25:
        parts.append(_block((width * 0.88, depth * 0.88, thick), (0, 0, random.uniform(0.1, 0.5) * height)))
    if random.random() < 0.2 and not round_:
        parts.append(_block((0.3 * width, 0.85 * depth, 0.7 * height), (0.32 * width, 0, 0.25 * height)))
    return parts


def chair(random: Random) -> list[CsgPart]:
    """Chairs, armchairs with legs, stools."""
    width, depth, seat = random.uniform(0.35, 0.6), random.uniform(0.35, 0.6), random.uniform(0.3, 0.6)
    back = random.uniform(0.3, 0.7) * (random.random() < 0.85)
    longest = max(width, depth, seat + back)
    thick = random.uniform(0.025, 0.12) * longest
    parts = [_block((width, depth, thick), (0, 0, seat), random.uniform(0, 0.4) * thick)]
    if random.random() < 0.15:  # office chair
        parts.append(CsgPart(body=Cylinder(0.04 * longest, seat), at=(0, 0, seat / 2)))
        for angle in np.arange(5) * 2 * np.pi / 5:
            tip = np.array([0.32 * np.cos(angle), 0.32 * np.sin(angle), 0.03])
            parts.append(CsgPart(body=Tube(np.stack([[0, 0, 0.07], tip]), 0.025 * longest), at=(0, 0, 0)))
    else:
        parts += _legs(random, width, depth, seat, longest)
    if back:
        lean = Rotation.from_euler("x", -random.uniform(0, 0.25)).as_matrix()
        sheet = random.uniform(0.02, 0.06) * longest
        at = (0.0, depth / 2 - sheet / 2, seat + back / 2)
        if random.random() < 0.55:
            parts.append(CsgPart(body=Box((width, sheet, back), 0.3 * sheet), at=at, turn=lean))
        else:
            post = max(sheet, 0.03 * longest)
            for sx in (-1, 1):
                x = sx * (width - post) / 2
                parts.append(CsgPart(body=Box((post, post, back)), at=(x, at[1], at[2]), turn=lean))
            upright = random.random() < 0.4
            count = random.integers(2, 5)
            for i in range(count):
                if upright:
                    x = (i + 0.5) / count * (width - post) - (width - post) / 2
                    parts.append(CsgPart(body=Box((post * 0.7, post * 0.7, back)), at=(x, at[1], at[2]), turn=lean))
                else:
                    z = (i + 1 - count / 2) / count * back * 0.9
                    place = np.array(at) + lean @ np.array([0, 0, z])
                    parts.append(CsgPart(body=Box((width, post * 0.7, back * 0.12)), at=tuple(place), turn=lean))
            parts.append(CsgPart(body=Box((width, post, post)), at=(0, *(np.array(at) + lean @ [0, 0, back / 2])[1:])))
    if random.random() < 0.3:
        rise, arm = random.uniform(0.12, 0.25), 0.035 * longest
        for sx in (-1, 1):
            x = sx * (width - arm) / 2
            parts.append(_block((arm, depth, arm), (x, 0, seat + rise)))
            parts.append(_block((arm, arm, rise), (x, -depth / 2 + arm, seat)))
    return parts


def shelf(random: Random) -> list[CsgPart]:
    """Shelves and open cabinets: sides and boards, with a back or without, compartments left open."""
    width, depth, height = random.uniform(0.3, 1.4), random.uniform(0.2, 0.5), random.uniform(0.4, 2.0)
    longest = max(width, height)
    board = random.uniform(0.02, 0.04) * longest
    foot = random.uniform(0, 0.12) * height * (random.random() < 0.4)
    parts = [_block((board, depth, height), (sx * (width - board) / 2, 0, 0)) for sx in (-1, 1)]
    levels = np.linspace(foot, height - board, random.integers(2, 7))
    if random.random() < 0.3:
        levels[1:-1] += random.uniform(-0.05, 0.05, len(levels) - 2) * height
    parts += [_block((width, depth, board), (0, 0, z)) for z in levels]
    if random.random() < 0.6:
        back = max(0.5 * board, 0.02 * longest)
        parts.append(_block((width, back, height - foot), (0, (depth - back) / 2, foot)))
    for _ in range(random.integers(0, 3)):
        parts.append(_block((board, depth, height - foot), (random.uniform(-0.4, 0.4) * width, 0, foot)))
    if random.random() < 0.5:  # some compartments are closed by doors or drawers, or hold things
        for _ in range(random.integers(1, 4)):
            i = random.integers(len(levels) - 1)
            rise = (levels[i + 1] - levels[i]) * random.uniform(0.5, 1.0)
            side = random.uniform(0.15, 0.9) * width
            x = random.uniform(-0.5, 0.5) * (width - side)
            parts.append(_block((side, depth * random.uniform(0.5, 1), rise), (x, 0, levels[i] + board)))
    return parts


def drawers(random: Random) -> list[CsgPart]:
    """Closed cabinets: a block with grooves and knobs, on feet or on the floor, maybe a drawer pulled or a hollow."""
    width, depth, height = random.uniform(0.4, 1.4), random.uniform(0.3, 0.6), random.uniform(0.3, 1.4)
    longest = max(width, depth, height)
    foot = random.uniform(0.05, 0.2) * (random.random() < 0.6)
    parts = [_block((width, depth, height - foot), (0, 0, foot), random.uniform(0, 0.01))]
    rows, columns = random.integers(1, 5), random.integers(1, 4)
    rise, side = (height - foot) / rows, width / columns
    gap = 0.02 * longest
    for row in range(rows):
        for column in range(columns):
            x, z = (column + 0.5) * side - width / 2, foot + (row + 0.5) * rise
            front = -depth / 2
            fate = random.random()
            if fate < 0.15:
                hollow = Box((side - 2.5 * gap, 2 * (depth - 2 * gap), rise - 2.5 * gap))
                parts.append(CsgPart(body=hollow, at=(x, front, z), operation="difference"))
            elif fate < 0.25:
                out = random.uniform(0.1, 0.5) * depth
                parts.append(CsgPart(body=Box((side - 2 * gap, out, rise - 2 * gap)), at=(x, front - out / 2, z)))
            elif random.random() < 0.7:
                parts.append(CsgPart(body=Box((side * 0.3, 3 * gap, 1.2 * gap)), at=(x, front, z + 0.2 * rise)))
    if foot:
        parts += _legs(random, width, depth, foot + 0.01, longest)
    if random.random() < 0.3:
        parts.append(_block((width * 1.05, depth * 1.05, 0.025 * longest), (0, 0, height)))
    return parts


def sofa(random: Random) -> list[CsgPart]:
    """Sofas and armchairs: base, back, arms, cushions; many stand on feet, with air below."""
    width, depth = random.uniform(0.7, 2.4), random.uniform(0.7, 1.1)
    foot = random.uniform(0.04, 0.18) * (random.random() < 0.7)
    base, back, arm = random.uniform(0.2, 0.4), random.uniform(0.3, 0.6), random.uniform(0.1, 0.3)
    soft = random.uniform(0.01, 0.08)
    sheet = random.uniform(0.12, 0.3)
    parts = [_block((width, depth, base), (0, 0, foot), soft)]
    parts.append(_block((width, sheet, base + back), (0, (depth - sheet) / 2, foot), soft))
    if random.random() < 0.85:
        rise = base + random.uniform(0.1, 0.3)
        parts += [_block((arm, depth, rise), (sx * (width - arm) / 2, 0, foot), soft) for sx in (-1, 1)]
    count = random.integers(1, 4)
    side = (width - 2 * arm) / count
    for i in range(count):
        x = (i + 0.5) * side - (width - 2 * arm) / 2
        parts.append(_block((side * 0.97, depth - sheet, 0.14), (x, -sheet / 2, foot + base), 0.05))
        if random.random() < 0.6:
            lean = Rotation.from_euler("x", -0.25).as_matrix()
            at = (x, depth / 2 - sheet - 0.08, foot + base + 0.3)
            parts.append(CsgPart(body=Box((side * 0.9, 0.16, 0.4), 0.07), at=at, turn=lean))
    if random.random() < 0.2:
        parts.append(_block((0.8, depth + 0.7, base), ((width - 0.8) / 2, -0.35, foot), soft))
    if foot:
        parts += _legs(random, width, depth, foot + 0.01, max(width, 1.0))
    return parts


def bed(random: Random) -> list[CsgPart]:
    """Beds: frame, mattress, headboard, pillows, a blanket over the edge; legs or box."""
    width, depth, foot = random.uniform(0.8, 2.0), random.uniform(1.8, 2.2), random.uniform(0.0, 0.3)
    frame, mattress = random.uniform(0.06, 0.2), random.uniform(0.12, 0.3)
    parts = [_block((width, depth, frame), (0, 0, foot))]
    parts.append(_block((width * 0.96, depth * 0.96, mattress), (0, 0, foot + frame), 0.06))
    if random.random() < 0.85:
        board = random.uniform(0.5, 1.2)
        sheet = random.uniform(0.05, 0.12)
        parts.append(_block((width, sheet, board), (0, (depth + sheet) / 2, 0)))
        if random.random() < 0.4:
            parts.append(_block((width, sheet, board * 0.6), (0, -(depth + sheet) / 2, 0)))
    top = foot + frame + mattress
    for x in [0.0] if width < 1.2 else [-width / 4, width / 4]:
        parts.append(_block((0.55, 0.4, 0.14), (x, depth * 0.35, top - 0.03), 0.06))
    if random.random() < 0.4:
        parts.append(_block((width * 1.04, depth * 0.6, mattress + 0.06), (0, -depth * 0.15, foot + frame), 0.05))
    if foot > 0.03:
        parts += _legs(random, width, depth, foot + 0.01, depth)
    else:
        parts.append(_block((width * 0.98, depth * 0.98, foot + 0.02), (0, 0, 0)))
    return parts


def lamp(random: Random) -> list[CsgPart]:
    """Floor, table and desk lamps; the shade is hollow."""
    height = random.uniform(0.3, 1.7)
    radius, pole = random.uniform(0.08, 0.2), random.uniform(0.012, 0.03) * max(height, 0.8) + 0.004
    parts = [CsgPart(body=Cylinder(radius, 0.05 * height + 0.01), at=(0, 0, 0.025 * height))]
    low, high, rise = random.uniform(0.1, 0.3), random.uniform(0.06, 0.25), random.uniform(0.12, 0.35)
    wall = 0.022 * max(height, 2 * low)
    x = 0.0
    if random.random() < 0.35:
        x = random.uniform(0.1, 0.4)
        bend = np.array([[0, 0, 0], [0, 0, height * 0.8], [x, 0, height]])
        parts.append(CsgPart(body=Tube(bend, pole), at=(0, 0, 0)))
    else:
        parts.append(CsgPart(body=Cylinder(pole, height), at=(0, 0, height / 2)))
        if random.random() < 0.4:
            parts.append(CsgPart(body=Cylinder(radius * 0.7, height * 0.5, 0.03), at=(0, 0, height * 0.28)))
    steep = (high - low) / rise
    shade, cavity = (
        np.array([[0, -h], [low - steep * (h - rise / 2), -h], [high + steep * (h - rise / 2), h], [0, h]])
        for h in (rise / 2, 0.6 * rise)
    )
    at = (x, 0.0, height + 0.2 * rise)
    standing = parts.copy()
    parts = [CsgPart(body=Lathe(np.maximum(shade, [[0, -9]])), at=at)]
    parts.append(CsgPart(body=Shrunk(Lathe(np.maximum(cavity, [[0, -9]])), wall), at=at, operation="difference"))
    parts += standing
    return parts


def appliance(random: Random) -> list[CsgPart]:
    """Screens on stands, speakers, ovens, washing machines, laptops: slabs and boxes with recesses."""
    width, depth, height = random.uniform(0.3, 1.2), random.uniform(0.15, 0.7), random.uniform(0.2, 1.0)
    longest = max(width, depth, height)
    sheet = random.uniform(0.03, 0.08) * longest
    match random.integers(4):
        case 0:  # screen
            neck = random.uniform(0.05, 0.3) * height
            return [
                _block((width, sheet, height - neck), (0, 0, neck), 0.2 * sheet),
                _block((0.2 * width, sheet, neck + 0.05), (0, sheet * 0.6, 0)),
                _block((random.uniform(0.3, 0.7) * width, depth, 0.025 * longest), (0, 0, 0)),
            ]
        case 1:  # laptop
            lean = Rotation.from_euler("x", -random.uniform(0.1, 0.6)).as_matrix()
            lid = Box((width, sheet, 0.7 * width))
            at = np.array([0, 0.35 * width, sheet]) + lean @ np.array([0, 0, 0.35 * width])
            return [_block((width, 0.7 * width, sheet), (0, 0, 0)), CsgPart(body=lid, at=tuple(at), turn=lean)]
        case 2:  # box with a recess or window
            inset = Box((0.7 * width, 2 * sheet, 0.6 * height), 0.0)
            parts = [_block((width, depth, height), (0, 0, 0), random.uniform(0, 0.05))]
            parts.append(
                CsgPart(
                    body=inset, at=(random.uniform(-0.1, 0.1) * width, -depth / 2, height / 2), operation="difference"
                )
            )
            if random.random() < 0.5:
                cavity = Box((0.75 * width, 1.7 * depth, 0.7 * height))
                parts.append(CsgPart(body=cavity, at=(0, -depth / 2, 0.52 * height), operation="difference"))
            return parts
        case _:  # bin, bucket, basket, suitcase with a handle
            parts = [_block((width, depth, height), (0, 0, 0), 0.1 * min(width, depth, height))]
            upright = Rotation.from_euler("x", np.pi / 2).as_matrix()
            parts.append(CsgPart(body=Torus(0.2 * width, 0.03 * longest), at=(0, 0, height), turn=upright))
            return parts


def plant(random: Random) -> list[CsgPart]:
    """A pot and leaves on stems."""
    radius, height = random.uniform(0.1, 0.25), random.uniform(0.15, 0.4)
    pot = np.array([[0, -height / 2], [0.7 * radius, -height / 2], [radius, height / 2], [0, height / 2]])
    parts = [CsgPart(body=Lathe(pot), at=(0, 0, height / 2))]
    for _ in range(random.integers(4, 12)):
        tip = np.array([*random.normal(0, 0.25, 2), height + random.uniform(0.1, 0.9)])
        parts.append(CsgPart(body=Tube(np.stack([[0, 0, height * 0.9], tip]), 0.02), at=(0, 0, 0)))
        leaf = np.array([0.14, 0.07, 0.03]) * random.uniform(0.6, 1.6)
        turn = Rotation.from_euler("zyx", random.uniform(-1.5, 1.5, 3)).as_matrix()
        parts.append(CsgPart(body=Box(tuple(leaf * 2), float(leaf.min() * 0.9)), at=tuple(tip), turn=turn))
    return parts


def cupboard(random: Random) -> list[CsgPart]:
    """Closed bodies as stand against walls: wardrobes, sideboards, refrigerators, kitchen units, chests."""
    width, depth = random.uniform(0.4, 2.2), random.uniform(0.3, 0.75)
    height = random.uniform(0.5, 2.2)
    longest = max(width, depth, height)
    foot = random.uniform(0.03, 0.2) * (random.random() < 0.5)
    parts = [_block((width, depth, height - foot), (0, 0, foot), random.choice([0.0, 0.0, 0.02, 0.05]))]
    front = -depth / 2
    columns, rows = random.integers(1, 5), random.integers(1, 4)
    groove, deep = 0.015 * longest, random.uniform(0.01, 0.02) * longest
    for i in range(1, columns):  # doors and drawers are grooves in the front
        x = (i / columns - 0.5) * width
        cut = Box((groove, 2 * deep, 0.92 * (height - foot)))
        parts.append(CsgPart(body=cut, at=(x, front, foot + (height - foot) / 2), operation="difference"))
    for j in range(1, rows):
        z = foot + j / rows * (height - foot)
        parts.append(CsgPart(body=Box((0.94 * width, 2 * deep, groove)), at=(0, front, z), operation="difference"))
    if random.random() < 0.5:
        for i in range(columns):
            x = ((i + random.choice([0.2, 0.8])) / columns - 0.5) * width
            grip = Box((1.5 * groove, 2 * deep, 0.1 * height))
            parts.append(CsgPart(body=grip, at=(x, front - deep, foot + 0.5 * (height - foot))))
    if random.random() < 0.4:
        parts.append(_block((1.04 * width, 1.06 * depth, 0.03 * longest), (0, 0, height)))
    if foot and random.random() < 0.6:
        parts += _legs(random, width, depth, foot + 0.01, longest)
    elif foot:
        parts.append(_block((0.94 * width, 0.88 * depth, foot + 0.01), (0, 0.04 * depth, 0)))
    return parts


_OFTEN = (table, shelf, cupboard)
FURNITURE: tuple[Maker, ...] = (table, chair, shelf, drawers, sofa, bed, lamp, appliance, plant, cupboard, *_OFTEN)
