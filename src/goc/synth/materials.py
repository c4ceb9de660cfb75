"""Procedural materials: a colour for each point in an object's own frame, so that no image files are needed.

Colours are linear reflectances in [0, 1].
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from goc.files.colour import decode_srgb
from goc.synth.noise import cell_random, fractal_noise, value_noise

Points = Float[np.ndarray, "p 3"]
Colours = Float[np.ndarray, "p 3"]
Rgb = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Appearance:
    """Colour, emission and gloss of p points."""

    colour: Colours
    """Linear reflectance."""
    glow: Colours | float = 0.0
    """Light that the surface emits; 1 is white in the image."""
    gloss: Float[np.ndarray, "p"] | float = 0.0
    """Share of a light's radiance that is reflected as in a mirror; 0 = matt."""


@runtime_checkable
class Material(Protocol):
    """Gives the appearance of points, which are in metres in the object's frame."""

    def appearance(self, points: Points) -> Appearance:
        """Appearance at each point."""
        ...


class NonEmissiveMaterial:
    """Base of materials that emit no light and have one gloss; subclasses define `colour`."""

    gloss: float

    def colour(self, points: Points) -> Colours:
        """Linear reflectance at each point."""
        raise NotImplementedError

    def appearance(self, points: Points) -> Appearance:
        """The colour, and the gloss."""
        return Appearance(colour=self.colour(points), gloss=self.gloss)


def linear(code: str) -> Rgb:
    """The linear reflectance of an sRGB hex code such as "c8a070"."""
    red, green, blue = decode_srgb(np.array([int(code[i : i + 2], 16) for i in (0, 2, 4)], np.uint8)).tolist()
    return red, green, blue


def mix(low: Rgb | Colours, high: Rgb | Colours, weight: Float[np.ndarray, "p"]) -> Colours:
    """Linear interpolation from `low` at weight 0 to `high` at weight 1."""
    first, second = np.asarray(low, np.float32), np.asarray(high, np.float32)
    return first + weight.astype(np.float32)[:, None] * (second - first)


def step(values: Float[np.ndarray, "p"], edge: float, softness: float) -> Float[np.ndarray, "p"]:
    """0 below the edge, 1 above, smooth over ± softness."""
    t = np.clip((values - edge) / (2 * softness) + 0.5, 0, 1)
    return t * t * (3 - 2 * t)


@dataclass(frozen=True)
class Paint(NonEmissiveMaterial):
    """Plain paint, plaster, plastic or glaze, slightly uneven."""

    base: Rgb
    unevenness: float = 0.06
    scale: float = 6.0
    gloss: float = 0.0

    def colour(self, points: Points) -> Colours:
        """The base colour, a little lighter and darker from place to place."""
        shade = 1 + 2 * self.unevenness * (fractal_noise(points * self.scale, 2) - 0.5)
        return shade[:, None] * np.asarray(self.base, np.float32)


@dataclass(frozen=True)
class Wood(NonEmissiveMaterial):
    """Sawn wood: long grain along one axis, darker late-wood lines, fine pores."""

    light: Rgb
    dark: Rgb
    grain: int = 0
    """Axis along which the fibres run: 0 = x, 1 = y, 2 = z."""
    gloss: float = 0.01

    def colour(self, points: Points) -> Colours:
        """Light and dark bands, stretched along the grain."""
        stretch = np.full(3, 9.0)
        stretch[self.grain] = 0.9
        local = points * stretch
        across = np.delete(np.arange(3), self.grain)
        warp = fractal_noise(local, 2)
        rings = (points[:, across[0]] + 0.6 * points[:, across[1]]) * 16 + 5.0 * warp
        band = np.abs(2 * (rings - np.floor(rings)) - 1)
        pores = value_noise(points * np.where(np.arange(3) == self.grain, 14.0, 260.0))
        return mix(self.light, self.dark, np.clip(0.62 * band**1.5 + 0.45 * warp - 0.12 + 0.16 * (pores - 0.5), 0, 1))


@dataclass(frozen=True)
class Fabric(NonEmissiveMaterial):
    """Woven cloth: a fine weave, lighter and darker threads, soft patches."""

    base: Rgb
    thread: Rgb
    weave: float = 90.0
    """Threads a metre, kept coarse enough to be seen by a camera."""
    gloss: float = 0.0

    def colour(self, points: Points) -> Colours:
        """Threads that cross, in noise."""
        x, y, z = (points * (2 * np.pi * self.weave)).T
        woven = 0.5 + 0.25 * (np.sin(x + y) * np.sin(z) + np.sin(x - y))
        threads = value_noise(points * 160.0)
        shade = 0.85 + 0.3 * fractal_noise(points * 5.0, 2)
        return mix(self.base, self.thread, 0.45 * woven + 0.55 * threads) * shade[:, None]


@dataclass(frozen=True)
class Stripes(NonEmissiveMaterial):
    """Bands of two colours along an axis, on cloth or glaze."""

    first: Rgb
    second: Rgb
    axis: int = 2
    period: float = 0.05
    share: float = 0.5
    """Part of a period that has the second colour."""
    gloss: float = 0.0

    def colour(self, points: Points) -> Colours:
        """Which band, with a little mottling."""
        phase = points[:, self.axis] / self.period
        phase = np.abs(2 * (phase - np.floor(phase)) - 1)
        shade = 0.92 + 0.16 * fractal_noise(points * 30.0, 2)
        return mix(self.first, self.second, step(phase, 1 - self.share, 0.04)) * shade[:, None]


@dataclass(frozen=True)
class BeachBall(NonEmissiveMaterial):
    """The coloured segments of a beach ball, round a vertical axis through the origin."""

    colours: tuple[Rgb, ...]
    cap: Rgb
    radius: float
    gloss: float = 0.02

    def colour(self, points: Points) -> Colours:
        """One colour for each sector, and caps at the poles."""
        turn = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) + 0.5
        sector = np.minimum((turn * len(self.colours)).astype(int), len(self.colours) - 1)
        chosen = np.asarray(self.colours, np.float32)[sector]
        polar = np.abs(points[:, 2] - self.radius)
        return mix(chosen, self.cap, step(polar, 0.92 * self.radius, 0.01 * self.radius))


@dataclass(frozen=True)
class Leaf(NonEmissiveMaterial):
    """A leaf that grew along x: a light midrib, veins, darker edges."""

    base: Rgb
    vein: Rgb
    gloss: float = 0.012

    def colour(self, points: Points) -> Colours:
        """Veins in a mottled green."""
        side = np.abs(points[:, 1])
        ribs = (points[:, 0] - 0.7 * side) * 45
        ribs = np.abs(2 * (ribs - np.floor(ribs)) - 1)
        veins = np.maximum(1 - step(side, 0.004, 0.003), 0.35 * step(ribs, 0.88, 0.1))
        shade = 0.8 + 0.4 * fractal_noise(points * 12.0, 2)
        return mix(self.base, self.vein, veins) * shade[:, None]


@dataclass(frozen=True)
class Book(NonEmissiveMaterial):
    """A bound book that lies flat, spine at +y: a cloth cover with a title block, paper on the other sides."""

    cover: Rgb
    title: Rgb
    size: tuple[float, float, float]
    gloss: float = 0.01

    def colour(self, points: Points) -> Colours:
        """Cover on both flat sides and the spine, leaves of paper between."""
        width, depth, height = self.size
        x, y, z = points.T
        board = 0.0035
        outside = (z < board) | (z > height - board) | (y > depth / 2 - board)
        leaves = value_noise(points * np.array([4.0, 4.0, 900.0]))
        paper = mix(linear("d8ceb4"), linear("efe8d6"), leaves)
        cloth = np.asarray(self.cover, np.float32) * (0.85 + 0.3 * fractal_noise(points * 60.0, 2))[:, None]
        block = (np.abs(x) < 0.3 * width) & (np.abs(y + 0.12 * depth) < 0.14 * depth)
        lines = (np.abs(x) < 0.28 * width) & (np.abs(z - height / 2) < 0.22 * height) & (y > depth / 2 - board)
        printed = mix(cloth, self.title, (block | lines).astype(np.float32))
        return np.where(outside[:, None], printed, paper).astype(np.float32)


@dataclass(frozen=True)
class LampShade:
    """A lamp shade, lit from within, brightest in its middle."""

    base: Rgb
    light: Rgb
    strength: float
    middle: float
    """Height of the bulb, metres in the object's frame."""

    def appearance(self, points: Points) -> Appearance:
        """Cloth whose light falls off from the bulb's height, in soft folds."""
        cloth = np.asarray(self.base, np.float32) * (0.9 + 0.2 * fractal_noise(points * 40.0, 2))[:, None]
        fall = np.exp(-(((points[:, 2] - self.middle) / 0.16) ** 2))
        folds = 0.85 + 0.15 * np.sin(26 * np.arctan2(points[:, 1], points[:, 0]))
        light = (self.strength * (0.35 + 0.65 * fall) * folds)[:, None] * np.asarray(self.light, np.float32)
        return Appearance(colour=cloth, glow=light)


@dataclass(frozen=True)
class Planks(NonEmissiveMaterial):
    """A wooden floor in the plane z = 0: staggered boards along x, each with its own tone and grain."""

    wood: Wood
    width: float = 0.14
    length: float = 1.3
    gloss: float = 0.014

    def colour(self, points: Points) -> Colours:
        """Boards, darker in the gaps."""
        row = np.floor(points[:, 1] / self.width)
        along = points[:, 0] / self.length + cell_random(row[:, None])
        board = np.floor(along)
        tone = cell_random(np.stack([board, row], -1))
        shifted = points + np.stack([3.1 * tone, 7.7 * tone, 5.3 * tone], -1)
        gap_x = np.minimum(along - board, board + 1 - along) * self.length
        across = points[:, 1] / self.width - row
        gap = np.minimum(gap_x, np.minimum(across, 1 - across) * self.width)
        shade = (0.8 + 0.4 * tone) * (0.45 + 0.55 * step(gap, 0.002, 0.0015))
        return self.wood.colour(shifted) * shade[:, None].astype(np.float32)


@dataclass(frozen=True)
class Tiles(NonEmissiveMaterial):
    """A tiled floor in the plane z = 0."""

    first: Rgb
    second: Rgb
    grout: Rgb
    size: float = 0.4
    gloss: float = 0.02

    def colour(self, points: Points) -> Colours:
        """Square tiles of two tones with marbling, and grout."""
        grid = points[:, :2] / self.size
        cell = np.floor(grid)
        tone = cell_random(cell)
        chequer = (cell.sum(-1) % 2).astype(np.float32)
        offset = np.stack([5 * tone, 9 * tone, 3 * tone], -1)
        marble = fractal_noise(points * 7.0 + offset, 3)
        tile = mix(self.first, self.second, chequer) * (0.75 + 0.25 * tone + 0.3 * (marble - 0.5))[:, None]
        edge = np.minimum(grid - cell, cell + 1 - grid).min(-1) * self.size
        return mix(self.grout, tile.astype(np.float32), step(edge, 0.004, 0.002))
