"""The materials and colours that the objects of one room share."""

from dataclasses import dataclass

import numpy as np

from goc.synth.materials import Fabric, Material, Paint, Planks, Rgb, Tiles, Wood, linear

_WOODS = [("d9b07c", "b07f48"), ("b9793f", "7c4a22"), ("8a5a3a", "55321d"), ("e0c8a0", "bd9c68")]
_CLOTHS = [("5b7a8c", "7f9cab"), ("7d8a5b", "9daa7c"), ("a85c4a", "c5806c"), ("8c8f94", "b4b6b8"), ("c9b28a", "e2d2b2")]
_ACCENTS = ["d98e32", "2f6f73", "b5483a", "4a5d8f", "e0b93f", "7b4a6d"]
_WALLS = ["d8d2c4", "c9d3d6", "dccfc0", "cfd6c6", "d9d9d6"]


@dataclass(frozen=True, kw_only=True)
class Style:
    """Materials that recur in one room."""

    wood: tuple[Rgb, Rgb]
    second_wood: tuple[Rgb, Rgb]
    cloth: tuple[Rgb, Rgb]
    second_cloth: tuple[Rgb, Rgb]
    accents: tuple[Rgb, ...]
    wall: Rgb
    accent_wall: Rgb
    floor: Material

    def timber(self, grain: int, second: bool = False) -> Wood:
        """The room's wood (or its second one) with fibres along an axis."""
        light, dark = self.second_wood if second else self.wood
        return Wood(light=light, dark=dark, grain=grain)

    def upholstery(self, second: bool = False) -> Fabric:
        """The room's cloth (or its second one)."""
        base, thread = self.second_cloth if second else self.cloth
        return Fabric(base=base, thread=thread)

    def accent(self, index: int) -> Rgb:
        """One of the strong colours for small things."""
        return self.accents[index % len(self.accents)]


METAL = Paint(base=linear("34343a"), unevenness=0.03, gloss=0.03)
WHITE = Paint(base=linear("e6e3dc"), unevenness=0.03, gloss=0.015)


def choose_style(rng: np.random.Generator) -> Style:
    """Pick woods, cloths, wall and floor that differ from each other."""
    woods = [(linear(light), linear(dark)) for light, dark in _WOODS]
    cloths = [(linear(base), linear(thread)) for base, thread in _CLOTHS]
    wood, second_wood, floor_wood = rng.permutation(len(woods))[:3]
    cloth, second_cloth = rng.permutation(len(cloths))[:2]
    accents = tuple(linear(_ACCENTS[i]) for i in rng.permutation(len(_ACCENTS)))
    wall = linear(_WALLS[rng.integers(len(_WALLS))])
    tint = np.asarray(linear(["6f8793", "8a9a7b", "b98a6a", "8d7f97"][rng.integers(4)]))
    light, dark = woods[floor_wood]
    floor: Material = Planks(wood=Wood(light=light, dark=dark), width=float(rng.uniform(0.12, 0.18)))
    if rng.random() < 0.3:
        floor = Tiles(first=linear("c9c2b4"), second=linear("b3a897"), grout=linear("7d766a"))
    return Style(
        wood=woods[wood],
        second_wood=woods[second_wood],
        cloth=cloths[cloth],
        second_cloth=cloths[second_cloth],
        accents=accents,
        wall=wall,
        accent_wall=(float(tint[0]), float(tint[1]), float(tint[2])),
        floor=floor,
    )
