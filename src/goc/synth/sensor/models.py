"""Settings of all faults, and the depth sensors by name."""

from dataclasses import dataclass, field

from goc.settings import Seed, Settings, Share
from goc.synth.sensor.depth import Lidar, StructuredLight
from goc.synth.sensor.images import ImageFaults
from goc.synth.sensor.monocular import MonocularDepth
from goc.synth.sensor.poses import PoseFaults

DepthModel = StructuredLight | Lidar | MonocularDepth

MODELS: dict[str, DepthModel | None] = {
    "exact": None,
    "kinect": StructuredLight(),
    "phone": Lidar(),
    "monocular": MonocularDepth(),
}
"""Depth sensors by name, at their defaults; "exact" leaves the depth as it is."""


@dataclass(frozen=True, kw_only=True)
class Faults(Settings):
    """Everything that can go wrong beside depth."""

    seed: Seed = 0
    """Of all randomness."""
    image: ImageFaults = field(default_factory=ImageFaults)
    pose: PoseFaults = field(default_factory=PoseFaults)
    masks: Share = 0.0
    """Share of each view's masks that are swapped, dropped, dilated or eroded."""


@dataclass(frozen=True, kw_only=True)
class SensorConfig(Faults):
    """All faults. The same settings and capture give the same bytes; no fault changes the others' random numbers."""

    depth: DepthModel | None = None
    """What measures the depth; None leaves it exact."""
