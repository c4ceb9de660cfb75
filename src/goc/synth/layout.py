"""Placement of objects in a room: against walls, on the floor, on top of each other, without overlap."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from goc.synth.model import Model, Top
from goc.synth.shapes import rotation
from goc.synth.shell import RoomSize

Bounds = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]
"""Lowest and highest corner."""
# Turn that brings a thing's back to the wall at +x, +y, -x, -y.
YAW_OF_WALL = (-np.pi / 2, 0.0, np.pi / 2, np.pi)


@dataclass(frozen=True, kw_only=True, eq=False)
class UprightBox:
    """An upright box with a turned rectangle as its base."""

    centre: Float[np.ndarray, "2"]
    half: Float[np.ndarray, "2"]
    yaw: float
    low: float
    high: float

    @property
    def axes(self) -> Float[np.ndarray, "2 2"]:
        """Unit directions of the sides, as rows."""
        return rotation("z", self.yaw)[:2, :2].T

    @property
    def corners(self) -> Float[np.ndarray, "4 2"]:
        """Corners of the base, counter-clockwise."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return self.centre + (signs * self.half) @ self.axes

    def apart(self, other: "UprightBox", gap: float) -> bool:
        """Whether the boxes are apart: one wholly above the other, or at least `gap` metres between them sideways."""
        if self.low >= other.high - 1e-9 or other.low >= self.high - 1e-9:
            return True
        for axis in (*self.axes, *other.axes):
            mine, theirs = self.corners @ axis, other.corners @ axis
            if max(theirs.min() - mine.max(), mine.min() - theirs.max()) >= gap:
                return True
        return False


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedModel:
    """A model placed in a room."""

    model: Model
    """The model in world coordinates."""
    footprint: UprightBox
    local: Model
    x: float
    y: float
    z: float
    yaw: float

    def top(self, index: int = 0) -> Top:
        """One of its tops, in the world; width is measured along the model's own x axis."""
        own = self.local.tops[index]
        across = rotation("z", self.yaw)[:2, :2] @ np.array([own.x, own.y])
        return Top(
            x=self.x + across[0],
            y=self.y + across[1],
            z=self.z + own.z,
            width=own.width,
            depth=own.depth,
            clearance=own.clearance,
        )


def place_model(model: Model, x: float, y: float, z: float, yaw: float) -> PlacedModel:
    """Place a model in the world; its lowest point comes to lie at z."""
    bounds = model.bounds
    world = model.turned(yaw).moved(x, y, z - bounds[0][2])
    return PlacedModel(model=world, footprint=_footprint(bounds, x, y, z, yaw), local=model, x=x, y=y, z=z, yaw=yaw)


def _footprint(bounds: Bounds, x: float, y: float, z: float, yaw: float) -> UprightBox:
    """The upright box of a placed model with these bounds in its own frame."""
    low, high = bounds
    middle = rotation("z", yaw)[:2, :2] @ (low + high)[:2] / 2
    return UprightBox(
        centre=np.array([x, y]) + middle, half=(high - low)[:2] / 2, yaw=yaw, low=z, high=z + high[2] - low[2]
    )


class Layout:
    """The models placed so far, and the boxes that must stay free; mutable while a room is furnished."""

    def __init__(self, size: RoomSize, kept_free: tuple[UprightBox, ...]) -> None:
        self.size = size
        self.kept_free = kept_free
        self.things: list[PlacedModel] = []

    def add(self, thing: PlacedModel | None) -> PlacedModel | None:
        """Add a placed model, unless it is None; returns it."""
        if thing is not None:
            self.things.append(thing)
        return thing

    def fits(self, footprint: UprightBox, gap: float, below: PlacedModel | None = None) -> bool:
        """Whether a box lies inside the room, and at least `gap` metres from all others but the one below it."""
        inside = (np.abs(footprint.corners) <= self.size.half[:2] - 0.015).all()
        others = [other.footprint for other in self.things if other is not below] + list(self.kept_free)
        return bool(inside) and all(footprint.apart(other, gap) for other in others)

    def against_wall(self, model: Model, side: int, along: float, gap: float = 0.06) -> PlacedModel | None:
        """Place a model with its back to a wall, centred at `along` on it; None where something is in the way."""
        reach = self.size.half[side % 2] - 0.03 - model.bounds[1][1]
        sign = 1 if side < 2 else -1
        x, y = (sign * reach, along) if side % 2 == 0 else (along, sign * reach)
        thing = place_model(model, x, y, 0.0, YAW_OF_WALL[side])
        return thing if self.fits(thing.footprint, gap) else None

    def first_free(
        self, model: Model, spots: Float[np.ndarray, "k 3"], gap: float, z: float = 0.0
    ) -> PlacedModel | None:
        """Place a model at the first of the poses (x, y, yaw) that is free; None where none is."""
        bounds = model.bounds
        for x, y, yaw in spots.tolist():
            if self.fits(_footprint(bounds, x, y, z, yaw), gap):
                return place_model(model, x, y, z, yaw)
        return None

    def on_top(self, model: Model, below: PlacedModel, index: int, rng: np.random.Generator) -> PlacedModel | None:
        """Place a model on a top of another one, wholly inside its edge; None where there is no room left.

        Tops are free areas, so the object below need not be tested.
        """
        top = below.top(index)
        low, high = model.bounds
        if high[2] - low[2] > top.clearance - 0.01:
            return None
        for turn in rng.uniform(-0.4, 0.4, 60):
            reach = np.abs(rotation("z", float(turn))[:2, :2]) @ np.abs([low[:2], high[:2]]).max(0)
            room = np.array([top.width, top.depth]) / 2 - reach
            if (room < 0).any():
                continue
            shift = rotation("z", below.yaw)[:2, :2] @ (rng.uniform(-1, 1, 2) * room)
            x, y, yaw = float(top.x + shift[0]), float(top.y + shift[1]), below.yaw + float(turn)
            if self.fits(_footprint((low, high), x, y, top.z, yaw), 0.03, below):
                return place_model(model, x, y, top.z, yaw)
        return None
