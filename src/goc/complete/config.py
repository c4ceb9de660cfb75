"""Settings of stage 4."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from goc.errors import ConfigError

Method = Literal["none", "hull", "lite", "osc"]
ScanMethod = Literal["smooth", "hull", "lite", "osc"]


@dataclass(frozen=True, kw_only=True)
class CompleteConfig:
    """How the surface that nobody saw is filled in."""

    method: Method = "lite"
    """lite: the network that goc ships (or --weights) says what is solid. osc: one of the paper's size does, from
    --weights. hull: whatever no ray contradicts is solid. none: objects stay open."""
    weights: Path | None = None
    """The network's weights, as `goc osc train` makes them; left out: those packaged with goc, where there are any."""
    threshold: float = 0.5
    """Occupancy from which on a network's answer counts as solid, between 0 and 1; the paper's T_b is 0.3."""
    coarse_cells: int = 64
    """Cells along the longest side in which a network is asked at first; finer only where its surface can be."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        if not 0.0 < self.threshold < 1.0:
            raise ConfigError(f"--complete.threshold is {self.threshold}: it is an occupancy, above 0 and below 1.")
        if not 8 <= self.coarse_cells <= 512:
            raise ConfigError(f"--complete.coarse-cells is {self.coarse_cells}: needs 8 to 512.")
        if self.method == "osc" and self.weights is None:
            raise ConfigError("--complete.method osc needs --complete.weights: goc ships no weights of that size.")
        if self.weights is not None and self.method in ("none", "hull"):
            raise ConfigError(
                f"--complete.weights is given, but --complete.method {self.method} uses none. "
                "Pass --complete.method lite."
            )


@dataclass(frozen=True, kw_only=True)
class ScanConfig:
    """How one partial scan is closed, of which nothing is known but its points, and where they were seen from."""

    method: ScanMethod = "smooth"
    """smooth: as smoothly as the normals ask (Poisson). hull: all that the viewpoint does not see to be empty.
    lite, osc: a network says what is solid."""
    viewpoint: tuple[float, float, float] | None = None
    """Where the sensor stood, in the scan's frame and unit: what it saw past is empty, and normals look towards it."""
    weights: Path | None = None
    """The network's weights, as `goc osc train` makes them; left out: those packaged with goc, where there are any."""
    threshold: float = 0.5
    """Occupancy from which on a network's answer counts as solid, between 0 and 1."""
    cells: int = 128
    """Voxels along the scan's longest side; fewer where its points lie further apart."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        if not 0.0 < self.threshold < 1.0:
            raise ConfigError(f"--threshold is {self.threshold}: it is an occupancy, above 0 and below 1.")
        if not 16 <= self.cells <= 400:
            raise ConfigError(f"--cells is {self.cells}: needs 16 to 400.")
        if self.viewpoint is not None and not all(math.isfinite(value) for value in self.viewpoint):
            raise ConfigError(f"--viewpoint is {self.viewpoint}: needs three finite numbers.")
        if self.method == "hull" and self.viewpoint is None:
            raise ConfigError("--method hull needs --viewpoint: without it nothing is empty, and the hull is a box.")
        if self.method == "osc" and self.weights is None:
            raise ConfigError("--method osc needs --weights: goc ships no weights of that size.")
        if self.weights is not None and self.method in ("smooth", "hull"):
            raise ConfigError(f"--weights is given, but --method {self.method} uses none. Pass --method lite.")
