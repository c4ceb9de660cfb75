"""Models of lamps, plants, and small objects that stand on tables and shelves. Base on z = 0, metres."""

import numpy as np

from goc.synth.materials import BeachBall, Book, LampShade, Leaf, Material, Paint, Stripes, linear
from goc.synth.model import Model, ModelPart, make_part, placed, tilted
from goc.synth.shapes import PartMesh, ball, cylinder, lathe, rounded_box, smooth_profile, tube
from goc.synth.style import METAL, WHITE, Style

Rng = np.random.Generator


def floor_lamp(rng: Rng, style: Style) -> Model:
    """A standing lamp with a cloth shade, lit."""
    height, radius = float(rng.uniform(1.45, 1.6)), float(rng.uniform(0.19, 0.23))
    bottom = height - float(rng.uniform(0.26, 0.32))
    parts = [
        make_part(cylinder(0.15, 0.025, 0.006, 40), METAL),
        placed(make_part(cylinder(0.014, bottom - 0.0, 0.002, 16), METAL), z=0.02),
        make_part(_lamp_shade(radius, 0.8 * radius, bottom, height), _cloth_shade((bottom + height) / 2)),
    ]
    return Model(name="floor lamp", parts=tuple(parts))


def table_lamp(rng: Rng, style: Style) -> Model:
    """A ceramic foot under a small lit shade."""
    foot = smooth_profile([(0, 0), (0.055, 0), (0.075, 0.06), (0.03, 0.15), (0.012, 0.2), (0.012, 0.26), (0, 0.26)])
    glaze = Paint(base=style.accent(3), unevenness=0.12, scale=14.0, gloss=0.07)
    height, radius = float(rng.uniform(0.38, 0.44)), float(rng.uniform(0.12, 0.15))
    shade = make_part(_lamp_shade(radius, 0.75 * radius, 0.23, height), _cloth_shade(0.3))
    return Model(name="table lamp", parts=(make_part(lathe(foot), glaze), shade))


def _cloth_shade(middle: float) -> LampShade:
    return LampShade(base=linear("efe2c6"), light=linear("ffd9a0"), strength=0.75, middle=middle)


def _lamp_shade(low: float, high: float, bottom: float, top: float) -> PartMesh:
    """A conical wall, open above and below, with a thin disc across its middle that closes the mesh."""
    wall, middle = 0.008, 0.55 * bottom + 0.45 * top
    at_middle = 0.55 * low + 0.45 * high - wall
    points = [(0, middle), (at_middle, middle), (low - wall, bottom), (low, bottom), (high, top), (high - wall, top)]
    return lathe(np.array([*points, (at_middle, middle + 0.012), (0, middle + 0.012)]), 48)


def plant(rng: Rng, style: Style) -> Model:
    """A rubber plant: a pot with earth, a stem, big leaves all round."""
    pot_height, pot = float(rng.uniform(0.28, 0.36)), float(rng.uniform(0.15, 0.18))
    outline = [(0, 0), (0.72 * pot, 0), (pot, pot_height), (pot - 0.02, pot_height), (pot - 0.03, pot_height - 0.05)]
    glaze = Stripes(first=style.accent(4), second=WHITE.base, axis=2, period=0.2, share=0.35, gloss=0.02)
    earth = Paint(base=linear("3d2c20"), unevenness=0.4, scale=60.0)
    green, vein = linear("3f7a3a"), linear("8fb96a")
    height = float(rng.uniform(0.85, 1.1))
    stem = np.array([[0, 0, pot_height - 0.06], [0.02, 0.01, 0.6 * height], [-0.01, 0.02, 0.92 * height]])
    parts = [
        make_part(lathe(np.array([*outline, (0, pot_height - 0.05)]), 40), glaze),
        placed(make_part(cylinder(pot - 0.034, 0.02), earth), z=pot_height - 0.062),
        make_part(
            tube(stem, np.array([0.018, 0.014, 0.009])), Paint(base=linear("6d5a3a"), unevenness=0.2, scale=40.0)
        ),
    ]
    count = int(rng.integers(11, 15))
    for i in range(count):
        share = i / (count - 1)
        azimuth = 2.4 * i + float(rng.uniform(-0.3, 0.3))  # about the golden angle, as leaves grow
        z = pot_height + 0.12 + share * (0.9 * height - pot_height - 0.12)
        size = float(rng.uniform(0.26, 0.32)) * (1 - 0.3 * share)
        pitch = 0.15 + 0.9 * share
        leaf = _leaf(size, 0.42 * size, Leaf(base=green, vein=vein), float(i))
        leaf = tilted(tilted(leaf, "y", -pitch), "z", azimuth)
        parts.append(placed(leaf, 0.0, 0.01, z))
    return Model(name="plant", parts=tuple(parts))


def _leaf(length: float, width: float, material: Leaf, variant: float) -> ModelPart:
    """A pointed, drooping leaf along +x with its stalk, 8 mm thick so that sensors can measure it."""
    mesh = ball(0.5, 20)
    x, y, z = (mesh.vertices - np.array([0, 0, 0.5])).T * 2
    along = (x + 1) / 2
    flat = np.stack([along * length, y * width / 2 * (1 - 0.35 * along), 0.006 * z], -1)
    texture = flat + np.array([0, 0, 0.37 * variant])
    lifted = flat + np.stack([0 * along, 0 * along, -0.3 * length * along**2 + 0.1 * np.abs(flat[:, 1])], -1)
    shape = PartMesh(vertices=lifted, faces=mesh.faces)
    return ModelPart(mesh=shape, material=material, texture=texture)


def ball_toy(rng: Rng, style: Style) -> Model:
    """A beach ball, turned a little."""
    radius = float(rng.uniform(0.12, 0.16))
    colours = (style.accent(0), WHITE.base, style.accent(2), WHITE.base, style.accent(3), WHITE.base)
    round_part = make_part(ball(radius, 40), BeachBall(colours=colours, cap=WHITE.base, radius=radius))
    centred = tilted(placed(round_part, z=-radius), "x", float(rng.uniform(0.3, 1.2)))
    return Model(name="ball", parts=(placed(centred, z=radius),))


def mug(rng: Rng, style: Style) -> Model:
    """A glazed mug with a handle."""
    radius, height, wall = float(rng.uniform(0.04, 0.046)), float(rng.uniform(0.095, 0.11)), 0.006
    inner = radius - wall
    outline = [(0, 0), (radius - 0.006, 0), (radius, 0.006), (radius, height - 0.002), (radius - 0.003, height)]
    cavity = [(inner, height - 0.003), (inner, 0.016), (inner - 0.008, 0.009), (0, 0.009)]
    glaze = Stripes(first=style.accent(1), second=WHITE.base, axis=2, period=height, share=0.3, gloss=0.07)
    angles = np.linspace(-np.pi / 2, np.pi / 2, 11)
    bow = np.stack([radius - 0.002 + 0.03 * np.cos(angles), 0 * angles, 0.52 * height + 0.032 * np.sin(angles)], -1)
    handle = make_part(tube(bow, 0.0065), Paint(base=style.accent(1), gloss=0.07))
    return Model(name="mug", parts=(make_part(lathe(np.array(outline + cavity)), glaze), handle))


def vase(rng: Rng, style: Style) -> Model:
    """A glazed vase, open above."""
    belly, height = float(rng.uniform(0.07, 0.095)), float(rng.uniform(0.24, 0.32))
    outside = [(0, 0), (0.6 * belly, 0), (belly, 0.4 * height), (0.4 * belly, 0.8 * height), (0.55 * belly, height)]
    curve = smooth_profile(outside, 6)
    wall = 0.008
    inside = [(r - wall, z) for r, z in curve[::-1] if r > 2 * wall and z > wall]
    glaze = Stripes(first=style.accent(5), second=style.accent(0), axis=2, period=height / 3, share=0.4, gloss=0.08)
    profile = np.array([*map(tuple, curve), *inside, (0, wall)])
    return Model(name="vase", parts=(make_part(lathe(profile, 40), glaze),))


def fruit_bowl(rng: Rng, style: Style) -> Model:
    """A wide bowl with oranges and apples in it."""
    radius = float(rng.uniform(0.13, 0.15))
    outline = [(0, 0), (0.45 * radius, 0), (0.5 * radius, 0.008), (0.85 * radius, 0.035), (radius, 0.075)]
    cavity = [(radius - 0.006, 0.077), (0.84 * radius, 0.043), (0.5 * radius, 0.016), (0, 0.014)]
    bowl = make_part(lathe(np.array(outline + cavity), 44), Paint(base=style.accent(1), unevenness=0.1, gloss=0.07))
    parts = [bowl]
    for i, code in enumerate(["d97a1f", "b8352c", "d97a1f", "8fa83a"]):
        size = float(rng.uniform(0.034, 0.037))
        angle = 2 * np.pi * i / 3 + 0.4
        away = 0.045 if i < 3 else 0.0
        fruit = make_part(ball(size, 24), Paint(base=linear(code), unevenness=0.12, scale=45.0, gloss=0.03), i)
        parts.append(placed(fruit, away * np.cos(angle), away * np.sin(angle), 0.017 if i < 3 else 0.068))
    return Model(name="fruit bowl", parts=tuple(parts))


def book_pile(rng: Rng, style: Style) -> Model:
    """Three or four books, lying on each other not quite straight."""
    parts, z = [], 0.0
    for i in range(int(rng.integers(3, 5))):
        size = (
            float(rng.uniform(0.2, 0.24)) - 0.012 * i,
            float(rng.uniform(0.15, 0.17)),
            float(rng.uniform(0.022, 0.04)),
        )
        turned = tilted(_book(size, style, i), "z", float(rng.uniform(-0.25, 0.25)) + (np.pi if i % 2 else 0.0))
        parts.append(placed(turned, z=z))
        z += size[2]
    return Model(name="books", parts=tuple(parts))


def book_row(rng: Rng, style: Style, width: float) -> tuple[ModelPart, ...]:
    """Books that stand side by side, spines to the front (-y), from x = 0 to at most `width`."""
    parts: list[ModelPart] = []
    x = 0.0
    while True:
        thick, tall = float(rng.uniform(0.024, 0.045)), float(rng.uniform(0.2, 0.27))
        if x + thick > width:
            return tuple(parts)
        lying = _book((tall, float(rng.uniform(0.15, 0.18)), thick), style, len(parts) + int(rng.integers(3)))
        upright = tilted(tilted(lying, "y", -np.pi / 2), "z", np.pi)
        corner = upright.mesh.vertices.min(0)
        parts.append(placed(upright, x - corner[0], -corner[1], -corner[2]))
        x += thick + 0.001


def _book(size: tuple[float, float, float], style: Style, index: int) -> ModelPart:
    covers = (*style.accents, linear("3a3f4a"), linear("d6cdb8"))
    cover = covers[(5 * index + 2) % len(covers)]
    light = sum(cover) < 0.9
    cloth: Material = Book(cover=cover, title=linear("ece4cc" if light else "2c2c30"), size=size)
    mesh = rounded_box(size, 0.003)
    return ModelPart(mesh=mesh, material=cloth, texture=mesh.vertices, smooth=False)
