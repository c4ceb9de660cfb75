"""Settings of stage 4."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from goc.errors import ConfigError
from goc.settings import Finite, OpenShare, Range, Settings

Method = Literal["best", "none", "hull", "lite", "osc"]
ScanMethod = Literal["auto", "smooth", "convex", "hull", "lite", "osc"]
Up = Literal["x", "-x", "y", "-y", "z", "-z"]
Place = tuple[Finite, Finite, Finite]


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

    method: ScanMethod = "auto"
    """auto: the one that the scan's kind suits, told in the output. smooth: as smoothly as the normals ask (Poisson).
    convex: the convex hull of the points. hull: all that no viewpoint sees to be empty. lite, osc: a network."""
    viewpoint: tuple[Place, ...] = ()
    """Where the sensor stood, in the scan's frame and unit; again for each further place that it saw the thing from.
    What it saw past is empty, and normals look towards it. Left out: looked for."""
    find_viewpoint: bool = True
    """Without a viewpoint: take the file's, or the origin, or any place from which the points look like one depth
    image's."""
    up: Up | None = None
    """Direction in the scan's frame that points up; left out: across the support plane; y in .glb and .obj; -y in the
    frame of a camera; else z. Networks know upright things."""
    support_plane: tuple[Finite, Finite, Finite, Finite] | None = None
    """a b c d: the thing stands on the plane where a x + b y + c z + d = 0; above it, that is more than 0."""
    find_support: bool = False
    """The points hold what the thing stands on: the plane is found, taken out of the scan, and nothing is below it."""
    copies: bool = True
    """A scan that ends in an upright plane is half a thing, and gets its other half; one depth image of a thing that
    mirrors itself gets the mirrored side."""
    weights: Path | None = None
    """The network's weights, as `goc osc train` makes them; left out: those packaged with goc, where there are any."""
    threshold: OpenShare = 0.5
    """Occupancy from which on a network's answer counts as solid, between 0 and 1."""
    cells: Annotated[int, Range(least=16, most=400)] = 128
    """Voxels along the scan's longest side; fewer where its points lie further apart."""

    def __post_init__(self) -> None:
        """Refuse a method without what it needs, or with what it does not use."""
        super().__post_init__()
        if self.method == "hull" and not self.viewpoint and not self.find_viewpoint:
            text = "{method} hull needs {viewpoint}: without it nothing is empty, and the hull is a box."
            raise ConfigError(text, type(self))
        if self.support_plane is not None and not any(self.support_plane[:3]):
            raise ConfigError("{support_plane} needs a direction: its first three numbers are 0.", type(self))
        if self.support_plane is not None and self.find_support:
            raise ConfigError("{support_plane} is given: leave {find_support} out.", type(self))
        if self.method == "osc" and self.weights is None:
            raise ConfigError("{method} osc needs {weights}: goc ships no weights of that size.", type(self))
        if self.weights is not None and self.method in ("smooth", "convex", "hull"):
            text = f"{{weights}} is given, but {{method}} {self.method} uses none. Pass {{method}} lite."
            raise ConfigError(text, type(self))
