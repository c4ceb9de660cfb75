"""Settings of what is known before there are splats."""

from dataclasses import dataclass, field
from typing import Annotated

from goc.errors import ConfigError
from goc.settings import Count, CountOrNone, Positive, Range, Settings


@dataclass(frozen=True)
class StereoConfig(Settings):
    """Depth from photographs alone, where a capture brings none."""

    side_px: Annotated[int, Range(least=32, most=8192)] = 224
    """Longer side of the depth maps; the plane sweep works at half of it."""
    neighbours: Annotated[int, Range(least=1, most=256)] = 8
    """Views that each view is matched with; the three that match best count at each pixel."""
    planes: Annotated[int, Range(least=16, most=4096)] = 96
    """Depths of the plane sweep, a multiple of 16."""
    near_m: Positive = 0.15
    """Nearest surface looked for, metres; the range is then narrowed to what views agree on."""
    far_m: Positive = 20.0
    """Farthest surface looked for, metres."""
    refinements: Annotated[int, Range(least=0, most=100)] = 2
    """Rounds in which pixels try the slanted planes of their neighbours."""
    agreeing: Count = 2
    """Other views that must see the same surface for a pixel to be trusted."""
    max_views: Count = 240
    """Captures of more views are thinned to these."""

    def __post_init__(self) -> None:
        """Refuse an empty range of depths, and more agreeing views than there are."""
        super().__post_init__()
        if self.planes % 16:
            raise ConfigError(f"{{planes}} is {self.planes}: needs a multiple of 16.", type(self))
        if self.near_m >= self.far_m:
            text = f"{{near_m}} is {self.near_m:g}: needs less than {{far_m}} ({self.far_m:g})."
            raise ConfigError(text, type(self))
        if self.agreeing > self.neighbours:
            text = f"{{neighbours}} is {self.neighbours}: needs at least as many as {{agreeing}} ({self.agreeing})."
            raise ConfigError(text, type(self))


@dataclass(frozen=True)
class PriorsConfig(Settings):
    """What is found out about surfaces before there are splats, where a capture has no metric depth."""

    fewest_points: CountOrNone = 2000
    """With fewer points than this, depth is found by stereo between the photographs: to seed splats where there is no
    depth, and to align monocular depth with."""
    bend: bool = True
    """Let the monocular depth of each view give way, slowly across the image, until neighbours look alike."""
    stereo: StereoConfig = field(default_factory=StereoConfig)
    """Matching of the photographs."""
