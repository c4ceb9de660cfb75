"""Settings of the alignment of views."""

from dataclasses import dataclass
from typing import Annotated, Literal

from goc.settings import Positive, Range, Settings

Switch = Literal["auto", "on", "off"]


@dataclass(frozen=True)
class AlignConfig(Settings):
    """Whether cameras and photographs are corrected, and how far from what the capture says."""

    poses: Switch = "auto"
    """Move cameras until the depth and the photographs of their views agree. auto: where the capture has metric depth
    and its views disagree by more than `least_m` or `least_deg`."""
    exposure: Switch = "auto"
    """Give all photographs one exposure: gain and offset of each channel. auto: where their brightness differs
    by `least_brightness`."""
    position_m: Positive = 0.02
    """Standard deviation of the given camera positions, metres: cameras are held to them by this."""
    angle_deg: Annotated[float, Range(above=0, most=90)] = 1.0
    """Standard deviation of the given camera directions."""
    least_m: Positive = 0.002
    """Cameras that would move by less (median) are left as they are, if they would turn by little too."""
    least_deg: Positive = 0.1
    """Cameras that would turn by less (median) are left as they are, if they would move by little too."""
    least_brightness: Positive = 0.07
    """Photographs that show mid-grey less differently (median over pairs, as a share) are left as they are."""
