"""What an object stands on, and the planes that it cannot reach through."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64


@dataclass(frozen=True, kw_only=True, eq=False)
class HalfSpace:
    """The side of a plane that an object is on: of its points, normal · x ≥ offset."""

    normal: Float64[np.ndarray, "3"]
    """Unit, in the capture's world, towards the object."""
    offset: float
    """Scene units."""

    def depth(self, points: Float[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p"]:
        """Distance of points from the plane, positive on the object's side."""
        x, y, z = points.astype(np.float64).T
        return x * self.normal[0] + y * self.normal[1] + z * self.normal[2] - self.offset


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """Where an object stands."""

    on: tuple[int, ...]
    """Ids of what bears it, ascending; ROOM is the floor, or another level part of the room."""
    plane: HalfSpace
    """The top of what bears it: its normal is up, its offset the height of the contact along up."""
    confidence: float
    """0…1: how much of the ring round the footprint is seen at that height, less where the object's lowest measured
    points are far from it."""
