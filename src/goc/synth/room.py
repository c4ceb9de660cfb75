"""A furnished room: its size, style, openings, things and lights, all from one seed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from goc.errors import ConfigError
from goc.synth import decor, furniture
from goc.synth.layout import Layout, PlacedModel, UprightBox
from goc.synth.lighting import AreaLight
from goc.synth.materials import linear
from goc.synth.model import Model
from goc.synth.shell import (
    CEILING,
    FLOOR,
    CeilingLamp,
    Door,
    Panel,
    Picture,
    RoomSize,
    Rug,
    Window,
    light_of,
    make_shell,
)
from goc.synth.style import Style, choose_style

Rng = np.random.Generator
_ATTEMPTS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class FurnishedRoom:
    """Everything in world coordinates: floor at z = 0, z up, metres."""

    size: RoomSize
    shell: Model
    objects: dict[int, Model]
    """By id, 1…"""
    lights: tuple[AreaLight, ...]


def furnish_room(seed: int, objects: int) -> FurnishedRoom:
    """Draw a room with that many objects (6…16); the same seed gives the same room.

    Raises:
        ConfigError: no attempt found room for that many objects.
    """
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([seed, attempt])
        size = draw_size(rng)
        style = choose_style(rng)
        openings = draw_openings(rng, size, style)
        layout = _furnish(rng, style, size, openings, objects)
        if layout is not None:
            return finish_room(rng, style, layout, openings)
    raise ConfigError(
        f"seed {seed}: no place found for {objects} objects in {_ATTEMPTS} attempts. Ask for fewer objects."
    )


def draw_size(rng: Rng) -> RoomSize:
    """A living room."""
    return RoomSize(
        width=float(rng.uniform(4.9, 5.5)), depth=float(rng.uniform(4.1, 4.7)), height=float(rng.uniform(2.5, 2.7))
    )


@dataclass(frozen=True, kw_only=True)
class Openings:
    """Which walls have the window, the door and the sofa: 0…3 are the walls at +x, +y, -x, -y."""

    window: Panel
    door: Panel
    sofa_side: int


def draw_openings(rng: Rng, size: RoomSize, style: Style) -> Openings:
    """The sofa gets a long wall, the window one of the short walls, the door another wall."""
    sofa_side = int(rng.choice([1, 3]))
    window_side = int(rng.choice([0, 2]))
    width, height = float(rng.uniform(1.5, 1.9)), float(rng.uniform(1.15, 1.35))
    left = float(rng.uniform(-0.35, 0.35)) - width / 2
    window = Panel(
        side=window_side, left=left, bottom=0.9, width=width, height=height, art=Window(width=width, height=height)
    )
    door_side = 2 - window_side
    reach = size.wall_length(door_side) / 2 - 0.2 - 0.98
    start = reach if rng.random() < 0.5 else -reach - 0.98
    base = linear(["e8e4da", "b98b5e", "7d8f94"][rng.integers(3)])
    door = Panel(
        side=door_side, left=start, bottom=0.0, width=0.98, height=2.08, art=Door(width=0.98, height=2.08, base=base)
    )
    return Openings(window=window, door=door, sofa_side=sofa_side)


def _furnish(rng: Rng, style: Style, size: RoomSize, openings: Openings, count: int) -> Layout | None:
    """Place things in the order of their importance until there are `count`; None if some do not find a place."""
    layout = Layout(size, (before_door(openings.door, size),))
    done: dict[str, PlacedModel] = {}
    place = _Placer(rng=rng, style=style, layout=layout, openings=openings, done=done)
    groups = [[place.sideboard, place.vase], [place.table, place.chair, place.fruit_bowl]]
    if rng.random() < 0.5:
        groups.reverse()
    steps: list[Callable[[], PlacedModel | None]] = [place.sofa, place.coffee_table, place.bookshelf, place.floor_lamp]
    steps += [place.armchair, place.plant, place.mug, place.books, *groups[0], place.ball, *groups[1]]
    steps += [place.pouf, place.table_lamp]
    for step in sorted(steps[:count], key=lambda step: step in (place.ball, place.pouf)):
        thing = layout.add(step())
        if thing is None:
            return None
        done[step.__name__] = thing
    return layout


def before_door(door: Panel, size: RoomSize) -> UprightBox:
    """The box of floor in front of a door that must stay free."""
    half = size.half[door.side % 2]
    sign = 1 if door.side < 2 else -1
    middle, depth = door.left + door.width / 2, 0.8
    centre = np.array([sign * (half - depth / 2), middle])
    extent = np.array([depth / 2, door.width / 2])
    if door.side % 2 == 1:
        centre, extent = centre[::-1], extent[::-1]
    return UprightBox(centre=centre, half=extent, yaw=0.0, low=0.0, high=2.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Placer:
    """Makes and places the built-in objects, one method for each."""

    rng: Rng
    style: Style
    layout: Layout
    openings: Openings
    done: dict[str, PlacedModel]

    def sofa(self) -> PlacedModel | None:
        model = furniture.sofa(self.rng, self.style)
        return self.layout.against_wall(model, self.openings.sofa_side, float(self.rng.uniform(-0.5, 0.5)))

    def coffee_table(self) -> PlacedModel | None:
        model = furniture.coffee_table(self.rng, self.style)
        sofa = self.done["sofa"]
        away = 0.44 + float(self.rng.uniform(0.36, 0.5)) + model.bounds[1][1]
        spots = _beside(sofa, np.array([[float(self.rng.uniform(-0.15, 0.15)), -away, 0.0]]))
        return self.layout.first_free(model, spots, 0.25)

    def bookshelf(self) -> PlacedModel | None:
        model = furniture.bookshelf(self.rng, self.style)
        sides = [side for side in range(4) if side not in (self.openings.window.side, self.openings.sofa_side)]
        return self._at_some_wall(model, sides)

    def sideboard(self) -> PlacedModel | None:
        model = furniture.sideboard(self.rng, self.style)
        sides = [(self.openings.sofa_side + 2) % 4, self.openings.window.side]
        return self._at_some_wall(model, sides)

    def _at_some_wall(self, model: Model, sides: list[int]) -> PlacedModel | None:
        for _ in range(80):
            side = sides[int(self.rng.integers(len(sides)))]
            reach = self.layout.size.wall_length(side) / 2 - model.bounds[1][0] - 0.1
            thing = self.layout.against_wall(model, side, float(self.rng.uniform(-reach, reach)), 0.15)
            if thing is not None:
                return thing
        return None

    def armchair(self) -> PlacedModel | None:
        """Near the coffee table, turned towards it."""
        model = furniture.armchair(self.rng, self.style)
        return self.layout.first_free(model, facing_spots(self.done["coffee_table"], 0.98, 1.3, self.rng), 0.2)

    def floor_lamp(self) -> PlacedModel | None:
        lamp = decor.floor_lamp(self.rng, self.style)
        return self.layout.first_free(lamp, corner_spots(self.layout.size, 0.36, self.rng), 0.05)

    def plant(self) -> PlacedModel | None:
        plant = decor.plant(self.rng, self.style)
        return self.layout.first_free(plant, corner_spots(self.layout.size, 0.42, self.rng), 0.06)

    def table(self) -> PlacedModel | None:
        model = furniture.dining_table(self.rng, self.style)
        reach = self.layout.size.half[:2] - 0.75
        spots = self.rng.uniform(-1, 1, (120, 3)) * np.array([*reach, 0.0])
        spots[:, 2] = self.rng.choice([0, np.pi / 2], 120)
        return self.layout.first_free(model, spots, 0.4)

    def chair(self) -> PlacedModel | None:
        model = furniture.chair(self.rng, self.style)
        return self.layout.first_free(model, facing_spots(self.done["table"], 0.6, 0.95, self.rng), 0.04)

    def ball(self) -> PlacedModel | None:
        return self._on_floor(decor.ball_toy(self.rng, self.style))

    def pouf(self) -> PlacedModel | None:
        return self._on_floor(furniture.pouf(self.rng, self.style))

    def _on_floor(self, model: Model) -> PlacedModel | None:
        spots = self.rng.uniform(-1, 1, (120, 3)) * np.array([*self.layout.size.half[:2] - 0.5, 3.0])
        return self.layout.first_free(model, spots, 0.15)

    def mug(self) -> PlacedModel | None:
        return self.layout.on_top(decor.mug(self.rng, self.style), self.done["coffee_table"], 0, self.rng)

    def books(self) -> PlacedModel | None:
        return self.layout.on_top(decor.book_pile(self.rng, self.style), self.done["coffee_table"], 0, self.rng)

    def vase(self) -> PlacedModel | None:
        return self.layout.on_top(decor.vase(self.rng, self.style), self.done["sideboard"], 0, self.rng)

    def table_lamp(self) -> PlacedModel | None:
        return self.layout.on_top(decor.table_lamp(self.rng, self.style), self.done["sideboard"], 0, self.rng)

    def fruit_bowl(self) -> PlacedModel | None:
        return self.layout.on_top(decor.fruit_bowl(self.rng, self.style), self.done["table"], 0, self.rng)


def corner_spots(size: RoomSize, inset: float, rng: Rng) -> Float[np.ndarray, "k 3"]:
    """Places (x, y, yaw) in the room's corners, then along its walls."""
    reach = size.half[:2] - inset
    corners = rng.permutation(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])) * reach
    walls = rng.uniform(-1, 1, (60, 2))
    walls[np.arange(60), rng.integers(0, 2, 60)] = rng.choice([-1, 1], 60)
    places = np.concatenate([corners, walls * reach])
    return np.concatenate([places, rng.uniform(-3, 3, (len(places), 1))], -1)


def facing_spots(target: PlacedModel, near: float, far: float, rng: Rng) -> Float[np.ndarray, "k 3"]:
    """Places (x, y, yaw) round a thing, `near` to `far` metres from its middle, turned towards it."""
    angles = rng.uniform(-np.pi, np.pi, 80)
    distances = rng.uniform(near, far, 80)
    x, y = target.x + distances * np.cos(angles), target.y + distances * np.sin(angles)
    yaw = np.arctan2(target.y - y, target.x - x) + np.pi / 2 + rng.uniform(-0.15, 0.15, 80)
    return np.stack([x, y, yaw], -1)


def _beside(thing: PlacedModel, offsets: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """Places (x, y, yaw) given in the frame of a thing."""
    cosine, sine = np.cos(thing.yaw), np.sin(thing.yaw)
    x = thing.x + cosine * offsets[:, 0] - sine * offsets[:, 1]
    y = thing.y + sine * offsets[:, 0] + cosine * offsets[:, 1]
    return np.stack([x, y, offsets[:, 2] + thing.yaw], -1)


def finish_room(rng: Rng, style: Style, layout: Layout, openings: Openings) -> FurnishedRoom:
    """Hang pictures where walls are free, lay the rug, close the shell, light it."""
    size = layout.size
    side_length = 0.6
    lamp = Panel(
        side=CEILING, left=-side_length / 2, bottom=-side_length / 2, width=side_length, height=side_length,
        art=CeilingLamp(side_length),
    )  # fmt: skip
    rug = _rug(rng, style, layout)
    panels = [openings.window, openings.door, lamp, rug]
    panels += _pictures(rng, style, layout, panels)
    lights = (light_of(openings.window, size, (7.5, 8.2, 9.2)), light_of(lamp, size, (13.0, 11.2, 8.8)))
    shell = make_shell(size, style, tuple(panels), accent_side=openings.sofa_side)
    return FurnishedRoom(
        size=size,
        shell=shell,
        objects={index + 1: thing.model for index, thing in enumerate(layout.things)},
        lights=lights,
    )


def _rug(rng: Rng, style: Style, layout: Layout) -> Panel:
    """Under the coffee table, reaching before the sofa; without one, in the middle of the room."""
    table = next((thing for thing in layout.things if thing.model.name == "coffee table"), None)
    x, y = (0.0, 0.0) if table is None else (table.x, table.y)
    width, depth = float(rng.uniform(1.9, 2.3)), float(rng.uniform(1.4, 1.6))
    art = Rug(
        width=width, height=depth, ground=style.upholstery(second=True), border=style.accent(4), stripe=style.accent(5)
    )
    return Panel(side=FLOOR, left=x - width / 2, bottom=y - depth / 2, width=width, height=depth, art=art)


def _pictures(rng: Rng, style: Style, layout: Layout, panels: list[Panel]) -> list[Panel]:
    """Up to five pictures on walls, clear of openings, of each other, and of what stands before the wall."""
    hung: list[Panel] = []
    for _ in range(60):
        side = int(rng.integers(4))
        width = float(rng.uniform(0.45, 0.9))
        height = width * float(rng.choice([0.7, 0.75, 1.3]))
        left = float(rng.uniform(-1, 1)) * (layout.size.wall_length(side) / 2 - 0.25 - width / 2) - width / 2
        bottom = 1.55 - height / 2
        near = [panel for panel in (*panels, *hung) if panel.side == side]
        clear = all(left - 0.15 > panel.left + panel.width or left + width + 0.15 < panel.left for panel in near)
        if len(hung) == 5 or height > 1.0 or not clear or _hidden(layout, side, left, left + width, bottom):
            continue
        hues = (style.accent(len(hung)), style.accent(len(hung) + 2), style.accent(len(hung) + 3))
        frame = linear("2b2622") if rng.random() < 0.5 else style.wood[0]
        art = Picture(width=width, height=height, frame=frame, hues=hues, seed=float(rng.uniform(0, 40)))
        hung.append(Panel(side=side, left=left, bottom=bottom, width=width, height=height, art=art))
    return hung


def _hidden(layout: Layout, side: int, left: float, right: float, bottom: float) -> bool:
    """Whether something tall stands before this stretch of wall."""
    axis, sign = side % 2, 1 if side < 2 else -1
    for thing in layout.things:
        low, high = thing.model.bounds
        depth = layout.size.half[axis] - (high[axis] if sign > 0 else -low[axis])
        beside = high[1 - axis] < left or low[1 - axis] > right
        if depth < 0.3 and not beside and high[2] > bottom:
            return True
    return False
