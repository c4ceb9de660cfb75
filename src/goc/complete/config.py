"""Settings of stage 4."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from goc.errors import ConfigError
from goc.settings import Finite, OpenShare, Range, Settings

Method = Literal["best", "none", "hull", "lite", "osc"]
ScanMethod = Literal["smooth", "hull", "lite", "osc"]


@dataclass(frozen=True, kw_only=True)
class CompleteConfig(Settings):
    """How the surface that nobody saw is filled in."""

    method: Method = "best"
    """best: for each object the candidate of least expected error, among the network, the convex hull, mirror images
    and extruded outlines. lite: the network that goc ships (or --weights) says what is solid.
    osc: one of the paper's size does, from --weights. hull: whatever no ray contradicts is solid. none: objects stay
    open."""
    weights: Path | None = None
    """The network's weights, as `goc osc train` makes them; left out: those packaged with goc, where there are any."""
    threshold: OpenShare = 0.5
    """Occupancy from which on a network's answer counts as solid, between 0 and 1; the paper's T_b is 0.3."""
    coarse_cells: Annotated[int, Range(least=8, most=512)] = 64
    """Cells along the longest side in which a network is asked at first; finer only where its surface can be."""
    faces: Annotated[int, Range(least=0)] = 20_000
    """Faces of a closed object, as far as one millimetre allows; 0 keeps the full resolution."""

    def __post_init__(self) -> None:
        """Refuse a method without what it needs, or with what it does not use."""
        super().__post_init__()
        if self.method == "osc" and self.weights is None:
            raise ConfigError("{method} osc needs {weights}: goc ships no weights of that size.", type(self))
        if self.weights is not None and self.method in ("none", "hull"):
            text = f"{{weights}} is given, but {{method}} {self.method} uses none. Pass {{method}} best."
            raise ConfigError(text, type(self))


@dataclass(frozen=True, kw_only=True)
class ScanConfig(Settings):
    """How one partial scan is closed, of which nothing is known but its points, and where they were seen from."""

    method: ScanMethod = "smooth"
    """smooth: as smoothly as the normals ask (Poisson). hull: all that the viewpoint does not see to be empty.
    lite, osc: a network says what is solid."""
    viewpoint: tuple[Finite, Finite, Finite] | None = None
    """Where the sensor stood, in the scan's frame and unit: what it saw past is empty, and normals look towards it."""
    weights: Path | None = None
    """The network's weights, as `goc osc train` makes them; left out: those packaged with goc, where there are any."""
    threshold: OpenShare = 0.5
    """Occupancy from which on a network's answer counts as solid, between 0 and 1."""
    cells: Annotated[int, Range(least=16, most=400)] = 128
    """Voxels along the scan's longest side; fewer where its points lie further apart."""

    def __post_init__(self) -> None:
        """Refuse a method without what it needs, or with what it does not use."""
        super().__post_init__()
        if self.method == "hull" and self.viewpoint is None:
            text = "{method} hull needs {viewpoint}: without it nothing is empty, and the hull is a box."
            raise ConfigError(text, type(self))
        if self.method == "osc" and self.weights is None:
            raise ConfigError("{method} osc needs {weights}: goc ships no weights of that size.", type(self))
        if self.weights is not None and self.method in ("smooth", "hull"):
            text = f"{{weights}} is given, but {{method}} {self.method} uses none. Pass {{method}} lite."
            raise ConfigError(text, type(self))
