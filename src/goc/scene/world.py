"""Which way is up, where the floor is, and how long a metre is."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """The capture's world, as simulators need to know it."""

    up: Float64[np.ndarray, "3"]
    """Unit, against gravity."""
    floor: float
    """up · x of the floor's points, scene units."""
    confidence: float
    """0…1: how sure up and floor are; 1 where a user said them."""
    units_per_metre: float
    """Scene units in one metre."""
    metric: bool
    """units_per_metre is known, not guessed."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Positions in the capture's files are those of this world plus this, scene units."""

    @property
    def level_from_world(self) -> Float64[np.ndarray, "4 4"]:
        """Capture's world → what every export is in: right-handed, z up, metres, floor at z = 0.

        The world's x stays x where up allows it: a world with z up is not turned.
        """
        across = np.eye(3)[0] if abs(self.up[0]) < 0.9 else np.eye(3)[1]
        x = across - (across @ self.up) * self.up
        x /= np.linalg.norm(x)
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack([x, np.cross(self.up, x), self.up]) / self.units_per_metre
        matrix[2, 3] = -self.floor / self.units_per_metre
        return matrix
