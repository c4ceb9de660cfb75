"""Models of furniture that stands on the floor. Front towards -y, base on z = 0, metres."""

import numpy as np

from goc.synth.decor import book_row
from goc.synth.materials import Fabric, Material, Paint, Stripes
from goc.synth.model import Model, ModelPart, Top, make_part, placed, tilted
from goc.synth.shapes import cushion, cylinder, prism, rounded_box, rounded_rectangle, tube
from goc.synth.style import METAL, WHITE, Style

Rng = np.random.Generator


def sofa(rng: Rng, style: Style) -> Model:
    """Two or three seats, arms, loose cushions."""
    seats = int(rng.integers(2, 4))
    inner = float(rng.uniform(0.54, 0.6)) * seats
    return Model(name="sofa", parts=_upholstered(rng, style, style.upholstery(), seats, inner))


def armchair(rng: Rng, style: Style) -> Model:
    """One seat of the same making as the sofa, in the room's second cloth."""
    inner = float(rng.uniform(0.54, 0.6))
    return Model(name="armchair", parts=_upholstered(rng, style, style.upholstery(second=True), 1, inner))


def _upholstered(rng: Rng, style: Style, cloth: Fabric, seats: int, inner: float) -> tuple[ModelPart, ...]:
    depth, arm = float(rng.uniform(0.82, 0.9)), float(rng.uniform(0.14, 0.2))
    arm_height, back_height = float(rng.uniform(0.42, 0.48)), float(rng.uniform(0.56, 0.62))
    parts = _four_legs(inner + 2 * arm - 0.12, depth - 0.12, 0.12, (0.018, 0.028), style.timber(2, second=True))
    parts.append(placed(make_part(rounded_box((inner + 0.004, depth - 0.03, 0.2), 0.02, 3), cloth), 0, 0.01, 0.115))
    for side in (-1, 1):
        box = rounded_box((arm, depth, arm_height), 0.05, 4)
        parts.append(placed(make_part(box, cloth, side), side * (inner + arm) / 2, 0, 0.115))
    back = rounded_box((inner + 0.004, 0.17, back_height), 0.05, 4)
    parts.append(placed(make_part(back, cloth, 3), 0, depth / 2 - 0.09, 0.115))
    each = inner / seats
    for i in range(seats):
        x = (i + 0.5) * each - inner / 2
        pad = make_part(cushion((each - 0.03, depth - 0.22, 0.12), 0.045, 0.012), cloth, 4 + i)
        parts.append(placed(pad, x, -0.1, 0.31))
        upright = tilted(make_part(cushion((each - 0.06, 0.1, 0.34), 0.045, 0.02), cloth, 8 + i), "x", -0.2)
        parts.append(placed(upright, x, depth / 2 - 0.28, 0.45))
    pillow = _pillow(rng, style)
    x = 0.0 if seats == 1 else (inner / 2 - 0.25) * float(rng.choice([-1, 1]))
    return (*parts, placed(pillow, x, depth / 2 - 0.47, 0.455))


def _pillow(rng: Rng, style: Style) -> ModelPart:
    cloth: Material = Fabric(base=style.accent(0), thread=style.accent(1), weave=60.0)
    if rng.random() < 0.6:
        cloth = Stripes(first=style.accent(0), second=WHITE.base, axis=0, period=0.09)
    pillow = tilted(make_part(cushion((0.38, 0.06, 0.36), 0.03, 0.035), cloth), "x", -0.42)
    return tilted(pillow, "z", float(rng.uniform(-0.2, 0.2)))


def coffee_table(rng: Rng, style: Style) -> Model:
    """A low table with round corners or a round top, and a shelf below."""
    width, depth, height = (
        float(rng.uniform(0.95, 1.15)),
        float(rng.uniform(0.52, 0.62)),
        float(rng.uniform(0.38, 0.44)),
    )
    wood = style.timber(0)
    board = make_part(prism(rounded_rectangle(width, depth, 0.07), 0.032, 0.004), wood, smooth=False)
    parts = [placed(board, z=height - 0.032)]
    parts += _four_legs(width - 0.14, depth - 0.14, height - 0.03, (0.018, 0.026), style.timber(2))
    shelf = make_part(prism(rounded_rectangle(width - 0.15, depth - 0.15, 0.03), 0.018, 0.003), wood, 2, smooth=False)
    parts.append(placed(shelf, z=0.13))
    top = Top(x=0.0, y=0.0, z=height, width=width - 0.08, depth=depth - 0.08)
    return Model(name="coffee table", parts=tuple(parts), tops=(top,))


def dining_table(rng: Rng, style: Style) -> Model:
    """A round table on one foot, or a rectangular one on four legs, for two."""
    height = float(rng.uniform(0.72, 0.75))
    if rng.random() < 0.5:
        radius = float(rng.uniform(0.42, 0.48))
        parts = [
            placed(make_part(cylinder(radius, 0.03, 0.005, 48), style.timber(0, second=True)), z=height - 0.03),
            placed(make_part(cylinder(0.035, height - 0.05), METAL), z=0.025),
            make_part(cylinder(0.25, 0.03, 0.01, 40), METAL),
        ]
        side = radius * 1.25
        return Model(
            name="round table", parts=tuple(parts), tops=(Top(x=0.0, y=0.0, z=height, width=side, depth=side),)
        )
    width, depth = float(rng.uniform(0.95, 1.15)), float(rng.uniform(0.65, 0.75))
    wood = style.timber(0, second=True)
    parts = [placed(make_part(rounded_box((width, depth, 0.032), 0.004), wood, smooth=False), z=height - 0.032)]
    parts += _four_legs(width - 0.1, depth - 0.1, height - 0.03, (0.024, 0.032), style.timber(2, second=True))
    for side in (-1, 1):
        rail = make_part(rounded_box((width - 0.12, 0.02, 0.07), 0.002), wood, side, smooth=False)
        parts.append(placed(rail, 0, side * (depth / 2 - 0.05), height - 0.1))
    top = Top(x=0.0, y=0.0, z=height, width=width - 0.08, depth=depth - 0.08)
    return Model(name="table", parts=tuple(parts), tops=(top,))


def chair(rng: Rng, style: Style) -> Model:
    """A wooden chair: padded seat, raked legs, slatted or solid back."""
    seat, width, depth = float(rng.uniform(0.43, 0.46)), 0.43, 0.43
    wood = style.timber(2, second=True)
    parts = [
        placed(
            make_part(prism(rounded_rectangle(width, depth, 0.06), 0.022), style.timber(0, second=True)), z=seat - 0.03
        )
    ]
    pad = make_part(cushion((width - 0.03, depth - 0.03, 0.028), 0.012, 0.006), style.upholstery(second=True), 5)
    parts.append(placed(pad, z=seat - 0.01))
    for x in (-1, 1):
        front = np.array([[x * 0.2, -0.2, 0.0], [x * 0.185, -0.175, seat - 0.02]])
        parts.append(make_part(tube(front, np.array([0.014, 0.02])), wood, x))
        rear = np.array(
            [[x * 0.2, 0.24, 0], [x * 0.19, 0.2, seat * 0.6], [x * 0.188, 0.19, seat], [x * 0.18, 0.27, seat + 0.44]]
        )
        parts.append(make_part(tube(rear, np.array([0.014, 0.02, 0.02, 0.014])), wood, 3 + x))
    heights = [0.14, 0.24, 0.34] if rng.random() < 0.5 else [0.22]
    for i, height in enumerate(heights):
        tall = 0.055 if len(heights) > 1 else 0.26
        slat = make_part(rounded_box((0.37, 0.016, tall), 0.006, 2, 8), style.timber(0, second=True), 7 + i)
        curve = 0.028 * (1 - (slat.mesh.vertices[:, 0] / 0.185) ** 2)
        bent = slat.mesh.bent(np.stack([0 * curve, curve, 0 * curve], -1)).turned("x", -0.18)
        parts.append(
            ModelPart(
                mesh=bent.moved(0, 0.19 + 0.18 * height, seat + height - 0.02),
                material=slat.material,
                texture=slat.texture,
            )
        )
    return Model(name="chair", parts=tuple(parts))


def bookshelf(rng: Rng, style: Style) -> Model:
    """An open shelf with a back panel, with books on its boards and two boxes below."""
    width, depth, levels = float(rng.uniform(0.75, 0.95)), 0.28, int(rng.integers(4, 6))
    step, board = float(rng.uniform(0.32, 0.36)), 0.022
    height = 0.06 + levels * step + board
    upright, flat = style.timber(2), style.timber(0)
    parts = [
        placed(
            make_part(rounded_box((width - 0.01, 0.012, height - 0.04), 0.002), flat, 9, smooth=False),
            0,
            depth / 2 - 0.007,
            0.03,
        )
    ]
    for side in (-1, 1):
        wall = make_part(rounded_box((board, depth, height), 0.003), upright, side, smooth=False)
        parts.append(placed(wall, side * (width - board) / 2))
    inner = width - 2 * board
    for level in range(levels + 1):
        z = 0.06 + level * step
        shelf = make_part(rounded_box((inner + 0.004, depth - 0.02, board), 0.002), flat, level, smooth=False)
        parts.append(placed(shelf, 0, -0.002, z))
        if 0 < level < levels:
            row = book_row(rng, style, inner * float(rng.uniform(0.35, 0.75)))
            shift = 0.005 - inner / 2
            if rng.random() < 0.5:  # at the other end of the board
                shift += inner - 0.01 - max(book.mesh.vertices[:, 0].max() for book in row)
            parts += [placed(book, shift, -0.08, z + board) for book in row]
    for side in (-1, 1):
        box = make_part(rounded_box((0.42 * inner, 0.22, 0.2), 0.012, 2), style.upholstery(side > 0), 20 + side)
        parts.append(placed(box, side * 0.25 * inner, -0.01, 0.06 + board))
    return Model(name="bookshelf", parts=tuple(parts))


def sideboard(rng: Rng, style: Style) -> Model:
    """A low cabinet on legs with doors and handles."""
    width, depth, height = float(rng.uniform(1.15, 1.5)), 0.4, float(rng.uniform(0.5, 0.6))
    doors, leg = int(rng.integers(2, 4)), 0.14
    body = make_part(rounded_box((width, depth - 0.02, height - leg + 0.005), 0.004), style.timber(0), smooth=False)
    parts = [placed(body, 0, 0.01, leg - 0.005)]
    parts += _four_legs(width - 0.16, depth - 0.12, leg, (0.014, 0.024), METAL)
    each = (width - 0.04) / doors
    fronts: Material = style.timber(0) if rng.random() < 0.4 else Paint(base=WHITE.base, gloss=0.012)
    for i in range(doors):
        x = (i + 0.5) * each - (width - 0.04) / 2
        panel = make_part(rounded_box((each - 0.012, 0.018, height - leg - 0.05), 0.003), fronts, 3 + i, smooth=False)
        parts.append(placed(panel, x, -depth / 2 + 0.015, leg + 0.025))
        knob = tilted(make_part(cylinder(0.011, 0.024), METAL), "x", np.pi / 2)
        parts.append(placed(knob, x + (each / 2 - 0.07) * (1 if i % 2 == 0 else -1), -depth / 2 + 0.008, leg + 0.26))
    top = Top(x=0.0, y=0.01, z=height, width=width - 0.1, depth=depth - 0.1)
    return Model(name="sideboard", parts=tuple(parts), tops=(top,))


def pouf(rng: Rng, style: Style) -> Model:
    """A round footstool of striped or plain cloth."""
    cloth: Material = style.upholstery()
    if rng.random() < 0.5:
        cloth = Stripes(first=style.accent(2), second=WHITE.base, axis=2, period=0.11)
    size = float(rng.uniform(0.42, 0.5))
    soft = make_part(cushion((size, size, 0.34), 0.15, 0.02), cloth)
    return Model(name="pouf", parts=(soft,))


def _four_legs(
    width: float, depth: float, height: float, radii: tuple[float, float], material: Material
) -> list[ModelPart]:
    """Tapered round legs, thinner at the floor, in the corners of a rectangle."""
    legs = []
    for i, (x, y) in enumerate([(-1, -1), (1, -1), (-1, 1), (1, 1)]):
        leg = make_part(cylinder(radii[0], height, 0.003, 20, top=radii[1]), material, i)
        legs.append(placed(leg, x * width / 2, y * depth / 2))
    return legs
