"""A capture: posed images, with depth and instance ids where there are any."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int16, UInt8
from torch import Tensor

from goc.scene.camera import Camera
from goc.scene.priors import CapturePriors

UNLABELLED = -1
"""Id of a pixel without a label: no loss and no vote uses it. Files store 255, or 65535 in 16 bits."""

DepthKind = Literal["metric", "affine", "inverse"]
"""Meaning of stored depth D. metric: z itself. affine: z = k·D + b. inverse: 1/z = k·D + b. As monocular networks
estimate depth, k > 0 and b are unknown and differ from view to view."""

ROOM = 0
"""Id of walls, floor and ceiling; objects count from 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """The decoded images of one view, all of the camera's height and width."""

    camera: Camera
    image: UInt8[Tensor, "h w 3"]
    """sRGB as stored."""
    depth: Float[Tensor, "h w"] | None = None
    """z along the optical axis, scene units; NaN = none. As stored if the capture's `depth_kind` is not metric."""
    normals: Float[Tensor, "h w 3"] | None = None
    """Unit, camera axes, towards the camera (z < 0); NaN = none."""
    ids: Int16[Tensor, "h w"] | None = None
    """0 = room, 1… = objects, UNLABELLED (-1) = unknown."""
    valid: Bool[Tensor, "h w"] | None = None
    """Where the photograph shows the scene; elsewhere (masked, transparent) no colour, depth or id counts. None:
    everywhere."""


@runtime_checkable
class FrameSource(Protocol):
    """A function that returns the view of an index, 0 ≤ index < number of views.

    Sources are built in layers. Each is a frozen dataclass that holds the layer below and its own data: paths, numbers
    and arrays, but no closure, so that a capture can be sent to another process (docs/decisions/0033). Callers share
    the frames and must not write into them. Several threads may call a source at once.
    """

    def __call__(self, index: int) -> Frame:
        """Return one view, decoded or computed now or taken from a cache."""
        ...


@dataclass(frozen=True, eq=False)
class StoredFrames:
    """Views in memory: the lowest layer of a capture that is made of arrays instead of files."""

    views: tuple[Frame, ...]

    def __call__(self, index: int) -> Frame:
        """Return one view."""
        return self.views[index]


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """Result of `goc.align.align`: what its capture was before, and what was measured of it."""

    cameras: tuple[Camera, ...]
    """As the capture gave them."""
    frames: FrameSource
    """Views as the capture gave them."""
    moved: bool
    """Whether cameras were corrected."""
    exposure: Float[Tensor, "n 3 2"] | None
    """Gain and offset of each channel of each photograph: given = gain · corrected + offset, 0 to 1. None where
    photographs are as they were."""
    metrics: dict[str, float] = field(default_factory=dict[str, float])
    """What was measured of the views' disagreement, by name."""
    settings: str = ""
    """What it was made with, as JSON: a stopped run goes on with the same settings only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointCloud:
    """Coloured points in the world, for example the sparse points of structure from motion."""

    positions: Float32[np.ndarray, "p 3"]
    colours: UInt8[np.ndarray, "p 3"]
    normals: Float32[np.ndarray, "p 3"] | None = None
    seen_from: Float64[np.ndarray, "3"] | None = None
    """Where the sensor stood, if its file says so."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Capture:
    """A set of posed views. `frames` decodes images when they are asked for, through bounded caches.

    A capture can be pickled at every stage, without the decoded images, and so be sent to a worker process.
    """

    cameras: tuple[Camera, ...]
    view_names: tuple[str, ...]
    """Name of each view in errors and reports: the path of its image inside the capture."""
    frames: FrameSource
    """Decodes or computes a view. Use `capture[index]`, which also takes negative indices."""
    has_depth: bool
    """Whether any view has depth, of any kind; other views may lack it."""
    has_ids: bool
    """Whether any view has instance ids."""
    depth_kind: DepthKind = "metric"
    """Meaning of the depth of all views."""
    points: PointCloud | None = None
    id_names: dict[int, str] = field(default_factory=dict[int, str])
    """Names of objects by id, where the capture gives them."""
    priors: CapturePriors | None = None
    """Result of `goc.priors.add_priors`; None before it ran."""
    alignment: Alignment | None = None
    """Result of `goc.align.align`; None before it ran, or where it had nothing to look at."""
    units_per_metre: float = 1.0
    """Scene units in a metre: a length in metres times this is a length in scene units. 1 where the capture is metric,
    otherwise a guess from the camera path, so that thresholds can be stated in metres. The word means the same of
    files: a depth image of 1000 units per metre holds millimetres."""
    metric: bool = True
    """Whether the unit is known to be the metre, not guessed."""
    up: tuple[float, float, float] | None = None
    """Which way is up in the world, to a few degrees, where the format says it."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What was taken off all positions, scene units: plus this, they are those of the files."""

    @property
    def has_metric_depth(self) -> bool:
        """Whether any view has depth that is z in scene units, which can be fused."""
        return self.has_depth and self.depth_kind == "metric"

    def __len__(self) -> int:
        return len(self.cameras)

    def __getitem__(self, index: int) -> Frame:
        return self.frames(range(len(self))[index])

    def __iter__(self) -> Iterator[Frame]:
        return (self.frames(index) for index in range(len(self)))
