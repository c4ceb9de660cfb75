"""A room furnished with meshes from a folder: large objects on the floor, small ones on top of them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from goc.errors import ConfigError
from goc.events import Listener
from goc.synth import furniture
from goc.synth.assets import Asset, MeshFolder, draw_assets
from goc.synth.collision import CollisionMesh, collision_mesh, height_above, interpenetrate
from goc.synth.layout import Layout, PlacedModel, place_model
from goc.synth.model import Model
from goc.synth.room import (
    FurnishedRoom,
    Openings,
    before_door,
    corner_spots,
    draw_openings,
    draw_size,
    facing_spots,
    finish_room,
)
from goc.synth.style import Style, choose_style

Rng = np.random.Generator

_ATTEMPTS = 20
_ON_FLOOR = 0.4
"""Share of the things that stand on the floor, where the folder has enough of each kind."""
_FLOOR_AREA, _MOST_AREA = 5.5, 8.0
"""Square metres that things on the floor may cover, so that there is room to walk: meshes, and built-in ones too."""
_TRIED = 12
"""Meshes read for each thing in the room, at most."""
_CONTACT = 0.01
"""Metres that a thing may have to sink or rise until it touches what it stands on."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stock:
    """The assets to choose from, in random order."""

    large: tuple[Asset, ...]
    small: tuple[Asset, ...]


def furnish_with_meshes(seed: int, objects: int, source: MeshFolder, notify: Listener) -> FurnishedRoom:
    """Draw a room with that many things from a folder; the same seed and folder give the same room.

    Two fifths of the things stand on the floor: those with a back against walls or before tables, tables where there is
    space, others along the walls. The others stand on the tops of these, or on the floor where the tops are full. Where
    the folder has no large thing that others can stand on, built-in furniture takes its place. No two things share
    space, by their true surfaces, and each touches what it stands on.

    Raises:
        FileError: the folder holds no meshes.
        ConfigError: too few of them are of use, or no attempt found room for all.
    """
    stock = _stock(seed, objects, source, notify)
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([seed, attempt])
        size = draw_size(rng)
        style = choose_style(rng)
        openings = draw_openings(rng, size, style)
        placer = _Placer(rng=rng, style=style, openings=openings, stock=stock, count=objects,
                         layout=Layout(size, (before_door(openings.door, size),)), meshes=[])  # fmt: skip
        if placer.furnish():
            return finish_room(rng, style, placer.layout, openings)
    raise ConfigError(
        f"seed {seed}: no place found for {objects} things of {source.folder} in {_ATTEMPTS} attempts. "
        "Ask for fewer --objects, or allow smaller things with --min-m."
    )


def _stock(seed: int, objects: int, source: MeshFolder, notify: Listener) -> _Stock:
    """Read meshes in random order until there are twice as many of each kind as are needed, or enough were tried."""
    large: list[Asset] = []
    small: list[Asset] = []
    drawn: Iterator[Asset] = draw_assets(source, np.random.default_rng([seed, 7]), notify)
    for asset in islice(drawn, _TRIED * objects):
        (large if asset.is_large else small).append(asset)
        supports = sum(asset.is_support for asset in large)
        if len(large) >= objects and len(small) >= 2 * objects and supports >= objects // 3:
            break
    drawn.close()
    if not large and not small:
        raise ConfigError(f"{source.folder}: no mesh is of use in a room. Check --scale and --up.")
    return _Stock(large=tuple(large), small=tuple(small))


def _covered(assets: list[Asset]) -> float:
    """Floor area, square metres."""
    return sum(float(asset.size[:2].prod()) for asset in assets)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Placer:
    """One attempt at furnishing one room."""

    rng: Rng
    style: Style
    openings: Openings
    stock: _Stock
    count: int
    layout: Layout
    meshes: list[CollisionMesh]
    """Collision meshes of the models in the layout, in the same order."""

    def furnish(self) -> bool:
        """Place everything; False where some object finds no place."""
        on_floor = round(_ON_FLOOR * self.count)
        if len(self.stock.small) < self.count - on_floor:
            on_floor = self.count - len(self.stock.small)
        chosen = self._chosen_for_floor(on_floor)
        if len(chosen) < on_floor or _covered(chosen) > _MOST_AREA:
            return False
        for asset in chosen:
            if not self._keep(self._on_floor(asset), None):
                return False
        for asset in self.stock.small:
            if len(self.layout.things) == self.count:
                break
            self._small(asset)
        return len(self.layout.things) == self.count

    def _chosen_for_floor(self, count: int) -> list[Asset]:
        """Large things, largest first: as many supports as the small things need, then others."""
        needed = max(1, round((self.count - count) / 3))
        areas = np.array([float(asset.size[:2].prod()) for asset in self.stock.large])
        # Weighted sampling without replacement (Efraimidis and Spirakis 2006): larger ones fill a room better.
        order = np.argsort(-(self.rng.random(len(areas)) ** (1 / np.maximum(areas, 1e-3))), kind="stable")
        large = [self.stock.large[i] for i in order]
        chosen = self._within_area([asset for asset in large if asset.is_support], needed, [])
        built_in = iter(self._built_in())
        while len(chosen) < min(needed, count):
            chosen.append(next(built_in))
        rest = [asset for asset in large if not any(asset is other for other in chosen)]
        chosen = self._within_area(rest, count, chosen)
        while len(chosen) < count and _covered(chosen) <= _MOST_AREA:
            chosen.append(next(built_in))
        return sorted(chosen, key=lambda asset: -float(asset.size[:2].prod()))

    def _within_area(self, candidates: list[Asset], count: int, chosen: list[Asset]) -> list[Asset]:
        """Add candidates until there are `count`, leaving out those for which the floor is too small."""
        kept = list(chosen)
        for asset in candidates:
            if len(kept) < count and _covered([*kept, asset]) <= _FLOOR_AREA:
                kept.append(asset)
        return kept

    def _built_in(self) -> Iterator[Asset]:
        """Furniture for folders that have too little; supports first."""
        makers: list[tuple[Callable[[Rng, Style], Model], bool]] = [
            (furniture.coffee_table, False),
            (furniture.sideboard, False),
            (furniture.dining_table, False),
            (furniture.sofa, True),
            (furniture.armchair, True),
            (furniture.bookshelf, False),
            (furniture.chair, True),
        ]
        while True:
            for make, has_back in makers:
                yield Asset(model=make(self.rng, self.style), has_back=has_back)

    def _on_floor(self, asset: Asset) -> PlacedModel | None:
        width, depth, height = asset.size
        is_table = asset.is_support and not asset.has_back and height < 0.85 and width < 2.5 * depth
        tables = [thing for thing in self.layout.things if thing.local.tops and 0.3 < thing.footprint.high < 0.85]
        if asset.has_back and max(width, depth) < 0.75 and tables and self.rng.random() < 0.6:
            table = tables[int(self.rng.integers(len(tables)))]
            away = float(np.linalg.norm(table.footprint.half)) + depth / 2
            found = self.layout.first_free(asset.model, facing_spots(table, away, away + 0.4, self.rng), 0.05)
            if found is not None:
                return found
        if is_table and self.rng.random() < 0.7:
            found = self._in_the_open(asset)
            if found is not None:
                return found
        if max(width, depth) < 0.6 and not asset.has_back:
            inset = 0.05 + float(np.linalg.norm([width, depth])) / 2
            return self.layout.first_free(asset.model, corner_spots(self.layout.size, inset, self.rng), 0.08)
        return self._at_some_wall(asset) or self._in_the_open(asset)

    def _in_the_open(self, asset: Asset) -> PlacedModel | None:
        reach = self.layout.size.half[:2] - 0.4 - float(asset.size[:2].max()) / 2
        spots = self.rng.uniform(-1, 1, (120, 3)) * np.array([*np.maximum(reach, 0.1), 0.0])
        spots[:, 2] = self.rng.choice([0, np.pi / 2, np.pi, -np.pi / 2], 120) + self.rng.normal(0, 0.05, 120)
        return self.layout.first_free(asset.model, spots, 0.35)

    def _at_some_wall(self, asset: Asset) -> PlacedModel | None:
        for _ in range(80):
            side = int(self.rng.integers(4))
            if side == self.openings.window.side and asset.size[2] > 0.85:
                continue  # it would stand before the window
            reach = max(0.0, self.layout.size.wall_length(side) / 2 - asset.size[0] / 2 - 0.08)
            thing = self.layout.against_wall(asset.model, side, float(self.rng.uniform(-reach, reach)), 0.12)
            if thing is not None:
                return thing
        return None

    def _small(self, asset: Asset) -> bool:
        """On some top, a larger one more likely; where all are full, on the floor if it can be seen there."""
        places = [(thing, index) for thing in self.layout.things for index in range(len(thing.local.tops))]
        areas = np.array([thing.local.tops[index].width * thing.local.tops[index].depth for thing, index in places])
        if asset.is_small and len(places):
            weights = areas**0.5
            count = min(len(places), 8)
            for choice in self.rng.choice(len(places), count, replace=False, p=weights / weights.sum()):
                below, index = places[choice]
                thing = self.layout.on_top(asset.model, below, index, self.rng)
                if self._keep(self._settled(thing, below), below):
                    return True
        if asset.size.max() < 0.2:
            return False
        spots = self.rng.uniform(-1, 1, (60, 3)) * np.array([*self.layout.size.half[:2] - 0.5, 3.0])
        return self._keep(self.layout.first_free(asset.model, spots, 0.15), None)

    def _settled(self, thing: PlacedModel | None, below: PlacedModel) -> PlacedModel | None:
        """The thing, sunk until it touches what it stands on; None where that is not a matter of millimetres."""
        if thing is None:
            return None
        gap = height_above(collision_mesh(thing.model), self._collision_mesh(below))
        return place_model(thing.local, thing.x, thing.y, thing.z - gap, thing.yaw) if abs(gap) <= _CONTACT else None

    def _collision_mesh(self, thing: PlacedModel) -> CollisionMesh:
        return next(mesh for other, mesh in zip(self.layout.things, self.meshes, strict=True) if other is thing)

    def _keep(self, thing: PlacedModel | None, below: PlacedModel | None) -> bool:
        """Add a thing unless it shares space with the one below it; boxes keep it away from all others."""
        if thing is None:
            return False
        mesh = collision_mesh(thing.model)
        if below is not None and interpenetrate(mesh, self._collision_mesh(below)):
            return False
        self.layout.add(replace(thing, model=replace(thing.model, name=thing.local.name)))
        self.meshes.append(mesh)
        return True
