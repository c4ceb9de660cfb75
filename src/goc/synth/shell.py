"""The empty room: floor, walls and ceiling, with panels on them (window, door, pictures, rug, ceiling lamp)."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from goc.synth.lighting import AreaLight
from goc.synth.materials import Appearance, Colours, Fabric, Material, Paint, Points, Rgb, linear, mix, step
from goc.synth.model import Model, make_part
from goc.synth.noise import fractal_noise, value_noise
from goc.synth.shapes import PartMesh
from goc.synth.style import WHITE, Style

FLOOR, CEILING = 4, 5
"""Sides of the room; 0…3 are the walls at +x, +y, -x, -y."""


@runtime_checkable
class Art(Protocol):
    """The picture on a panel: reflectance and emission at each of its points."""

    def paint(self, flat: Float[np.ndarray, "p 2"]) -> tuple[Colours, Colours]:
        """Reflectance and glow, metres from the panel's lower left corner."""
        ...


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A rectangle on a side of the room."""

    side: int
    left: float
    bottom: float
    width: float
    height: float
    art: Art


@dataclass(frozen=True, kw_only=True)
class RoomSize:
    """Inside of a room: x and y are centred, the floor is z = 0. Metres."""

    width: float
    depth: float
    height: float

    @property
    def half(self) -> Float[np.ndarray, "3"]:
        """Half the extent of each axis."""
        return np.array([self.width, self.depth, self.height]) / 2

    def wall_length(self, side: int) -> float:
        """Length of a wall."""
        return self.depth if side % 2 == 0 else self.width


@dataclass(frozen=True)
class ShellMaterial:
    """The material of all six sides of a room, chosen by the position of the point."""

    size: RoomSize
    wall: Rgb
    accent_wall: Rgb
    accent_side: int
    floor: Material
    panels: tuple[Panel, ...]

    def appearance(self, points: Points) -> Appearance:
        """Floor, paint, skirting or panel; light of the window's panes and of the ceiling lamp."""
        side, flat = on_sides(points, self.size)
        colours = np.zeros((len(points), 3), np.float32)
        light = np.zeros((len(points), 3), np.float32)
        gloss = np.zeros(len(points), np.float32)
        floor, ceiling = side == FLOOR, side == CEILING
        boards = self.floor.appearance(points[floor])
        colours[floor], gloss[floor] = boards.colour, boards.gloss
        colours[ceiling] = Paint(base=linear("eceae4"), unevenness=0.02).colour(points[ceiling])
        wall = ~(floor | ceiling)
        colours[wall] = self._walls(points[wall], side[wall])
        for panel in self.panels:
            on_side = np.flatnonzero(side == panel.side)
            u, v = flat[on_side, 0] - panel.left, flat[on_side, 1] - panel.bottom
            inside = (u >= 0) & (u <= panel.width) & (v >= 0) & (v <= panel.height)
            chosen = on_side[inside]
            if len(chosen):
                colours[chosen], light[chosen] = panel.art.paint(np.stack([u[inside], v[inside]], -1))
                gloss[chosen] = 0.0
        return Appearance(colour=colours, glow=light, gloss=gloss)

    def _walls(self, points: Points, side: np.ndarray) -> Colours:
        base = np.where((side == self.accent_side)[:, None], self.accent_wall, self.wall)
        shade = 1 + 0.08 * (fractal_noise(points * 1.7, 2) - 0.5) + 0.06 * (value_noise(points * 70.0) - 0.5)
        painted = base * shade[:, None]
        z = points[:, 2]
        board = np.asarray(WHITE.base) * (0.97 + 0.06 * value_noise(points * 40.0))[:, None]
        groove = (1 - 0.55 * step(z, 0.08, 0.002) * (1 - step(z, 0.086, 0.002)))[:, None]
        return (np.where((z < 0.083)[:, None], board, painted) * groove).astype(np.float32)


def on_sides(points: Points, size: RoomSize) -> tuple[np.ndarray, Float[np.ndarray, "p 2"]]:
    """Which side of the room each point lies on, and where: (along the wall, height), or (x, y)."""
    x, y, z = np.ascontiguousarray(points.T)
    half = size.half
    distances = np.stack([half[0] - x, half[1] - y, half[0] + x, half[1] + y, z, size.height - z])
    side = distances.argmin(0)
    along = np.choose(side, [y, x, y, x, x, x])
    return side, np.stack([along, np.where(side >= FLOOR, y, z)], -1)


@dataclass(frozen=True)
class Window:
    """Panes with a bright sky behind, in a white frame."""

    width: float
    height: float

    def paint(self, flat: Float[np.ndarray, "p 2"]) -> tuple[Colours, Colours]:
        """Frame and bars in white, sky over distant trees in the panes."""
        u, v = flat.T
        bar = np.minimum(np.abs(u - self.width / 2), np.abs(v - 0.68 * self.height)) < 0.022
        rim = np.minimum(np.minimum(u, self.width - u), np.minimum(v, self.height - v)) < 0.06
        edge = np.minimum(np.minimum(u, self.width - u), np.minimum(v, self.height - v))
        frame = (bar | rim)[:, None]
        place = np.stack([u * 3, v * 3, 0 * u], -1)
        clouds = fractal_noise(place, 3)
        sky = mix((0.75, 1.15, 1.9), (2.2, 2.3, 2.4), np.clip(0.35 + clouds - 0.6 * v / self.height, 0, 1))
        trees = v < self.height * (0.2 + 0.16 * fractal_noise(place * [2, 0, 0] + 3, 3))
        leaves = mix((0.22, 0.34, 0.16), (0.5, 0.66, 0.35), value_noise(place * 9))
        view = np.where(trees[:, None], leaves, sky)
        white = np.asarray(WHITE.base) * (0.75 + 0.25 * step(edge, 0.006, 0.004))[:, None]
        return np.where(frame, white, 0.03).astype(np.float32), np.where(frame, 0.0, view).astype(np.float32)


@dataclass(frozen=True)
class Door:
    """A closed panel door with a frame and a handle."""

    width: float
    height: float
    base: Rgb

    def paint(self, flat: Float[np.ndarray, "p 2"]) -> tuple[Colours, Colours]:
        """Frame, leaf with two raised panels drawn by light and shadow lines, handle."""
        u, v = flat.T
        edge = np.minimum(np.minimum(u, self.width - u), self.height - v)
        colours = mix(self.base, WHITE.base, (edge < 0.07).astype(np.float32))
        shade = 0.95 + 0.1 * fractal_noise(np.stack([u * 30, v * 3, 0 * u], -1), 2)
        shade *= 1 - 0.6 * np.exp(-(((edge - 0.07) / 0.004) ** 2))
        for low, high in ((0.2, 0.9), (1.05, 1.8)):
            inset = np.minimum(np.minimum(u - 0.2, self.width - 0.2 - u), np.minimum(v - low, high - v))
            shade *= 1 - 0.35 * np.exp(-((inset / 0.006) ** 2)) + 0.15 * np.exp(-(((inset - 0.02) / 0.008) ** 2))
        handle = (np.abs(v - 1.0) < 0.011) & (np.abs(u - 0.16) < 0.055)
        colours = np.where(handle[:, None], np.asarray(linear("55565a"), np.float32), colours * shade[:, None])
        return colours.astype(np.float32), np.zeros_like(colours, np.float32)


@dataclass(frozen=True)
class Picture:
    """A framed landscape in flat colours."""

    width: float
    height: float
    frame: Rgb
    hues: tuple[Rgb, Rgb, Rgb]
    seed: float

    def paint(self, flat: Float[np.ndarray, "p 2"]) -> tuple[Colours, Colours]:
        """Frame, white mount, sky with a sun, three ranges of hills."""
        u, v = flat.T
        edge = np.minimum(np.minimum(u, self.width - u), np.minimum(v, self.height - v))
        x, y = u / self.height, v / self.height
        picture = mix(linear("f2dfc0"), self.hues[0], np.clip(y, 0, 1))
        sun = np.hypot(x - 0.6 * self.width / self.height, y - 0.68) < 0.1
        picture = np.where(sun[:, None], np.asarray(linear("e9a13b"), np.float32), picture)
        for layer, (height, hue) in enumerate(zip((0.55, 0.42, 0.28), (*self.hues[1:], linear("2d3a3a")), strict=True)):
            ridge = np.stack([x * 4 + 7 * layer + self.seed, 0 * x, 0 * x + layer], -1)
            below = y < height * (0.6 + 0.6 * fractal_noise(ridge, 3))
            picture = np.where(below[:, None], np.asarray(hue, np.float32), picture)
        grain = 0.9 + 0.2 * value_noise(np.stack([u * 120, v * 120, 0 * u], -1))
        colours = np.where((edge < 0.08)[:, None], np.asarray(linear("ece8dd"), np.float32), picture * grain[:, None])
        colours = np.where((edge < 0.025)[:, None], np.asarray(self.frame, np.float32), colours)
        return colours.astype(np.float32), np.zeros_like(colours, np.float32)


@dataclass(frozen=True)
class Rug:
    """A woven rug with a border and stripes."""

    width: float
    height: float
    ground: Fabric
    border: Rgb
    stripe: Rgb

    def paint(self, flat: Float[np.ndarray, "p 2"]) -> tuple[Colours, Colours]:
        """Border, inner line, diamonds in rows."""
        u, v = flat.T
        edge = np.minimum(np.minimum(u, self.width - u), np.minimum(v, self.height - v))
        cloth = self.ground.colour(np.stack([u, v, 0 * u], -1))
        du, dv = u / 0.3 - np.floor(u / 0.3) - 0.5, v / 0.3 - np.floor(v / 0.3) - 0.5
        diamond = np.abs(np.abs(du) + np.abs(dv) - 0.34) < 0.07
        rim = (edge < 0.09) | (np.abs(edge - 0.14) < 0.015)
        colours = np.where(diamond[:, None], 0.5 * cloth + 0.5 * np.asarray(self.stripe), cloth)
        colours = np.where(rim[:, None], (0.35 * cloth + 0.65 * np.asarray(self.border)), colours)
        return colours.astype(np.float32), np.zeros_like(colours, np.float32)


@dataclass(frozen=True)
class CeilingLamp:
    """A flat square lamp."""

    size: float

    def paint(self, flat: Float[np.ndarray, "p 2"]) -> tuple[Colours, Colours]:
        """A glowing square in a rim."""
        rim = (np.abs(flat - self.size / 2).max(-1) > self.size / 2 - 0.03)[:, None]
        dark, bright = np.asarray(METAL_RIM, np.float32), np.array([3.2, 3.0, 2.6], np.float32)
        return np.where(rim, dark, 0.4).astype(np.float32), np.where(rim, 0.0, bright).astype(np.float32)


METAL_RIM = linear("8a8a88")


def make_shell(size: RoomSize, style: Style, panels: tuple[Panel, ...], accent_side: int) -> Model:
    """The room as a box whose faces look inwards."""
    x, y, z = size.half[0], size.half[1], size.height
    corners = np.array([[a, b, c] for a in (-x, x) for b in (-y, y) for c in (0.0, z)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))], np.int32)
    material = ShellMaterial(size, style.wall, style.accent_wall, accent_side, style.floor, panels)
    return Model(name="room", parts=(make_part(PartMesh(vertices=corners, faces=faces), material, smooth=False),))


def light_of(panel: Panel, size: RoomSize, radiance: Rgb) -> AreaLight:
    """The area light that a window or a ceiling lamp is."""
    half = size.half
    u, v = panel.left + panel.width / 2, panel.bottom + panel.height / 2
    if panel.side == CEILING:
        centre, across, along, facing = [u, v, size.height], [1, 0, 0], [0, 1, 0], [0, 0, -1]
    else:
        axis, sign = panel.side % 2, 1 if panel.side < 2 else -1
        centre = [sign * half[0], u, v] if axis == 0 else [u, sign * half[1], v]
        across, along = np.eye(3)[1 - axis], [0, 0, 1]
        facing = -sign * np.eye(3)[axis]
    return AreaLight(
        centre=np.array(centre, np.float64),
        across=panel.width * np.array(across, np.float64),
        along=panel.height * np.array(along, np.float64),
        facing=np.array(facing, np.float64),
        radiance=np.array(radiance),
    )
