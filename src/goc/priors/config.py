"""Settings of what is known before there are splats."""

from dataclasses import dataclass

from goc.errors import ConfigError


@dataclass(frozen=True)
class StereoConfig:
    """Depth from photographs alone, where a capture brings none."""

    side_px: int = 224
    """Longer side of the depth maps; the plane sweep works at half of it."""
    neighbours: int = 8
    """Views that each view is matched with; the three that match best count at each pixel."""
    planes: int = 96
    """Depths of the plane sweep, a multiple of 16."""
    near_m: float = 0.15
    """Nearest surface looked for, metres; the range is then narrowed to what views agree on."""
    far_m: float = 20.0
    """Farthest surface looked for, metres."""
    refinements: int = 2
    """Rounds in which pixels try the slanted planes of their neighbours."""
    agreeing: int = 2
    """Other views that must see the same surface for a pixel to be trusted."""
    max_views: int = 240
    """Captures of more views are thinned to these."""

    def __post_init__(self) -> None:
        name = "--reconstruct.seeding.stereo."
        if self.planes < 16 or self.planes % 16:
            raise ConfigError(f"{name}planes is {self.planes}: needs a multiple of 16.")
        if self.side_px < 32:
            raise ConfigError(f"{name}side-px is {self.side_px}: needs at least 32.")
        if not 0 < self.near_m < self.far_m:
            raise ConfigError(f"{name}near-m is {self.near_m} and {name}far-m {self.far_m}: needs 0 < near < far.")
        if not 1 <= self.agreeing <= self.neighbours:
            raise ConfigError(
                f"{name}neighbours is {self.neighbours}: needs at least as many as agree "
                f"({name}agreeing is {self.agreeing})."
            )
