"""What was photographed: posed images, with depth and instance ids where there are any."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, Int16, UInt8
from torch import Tensor

from goc.scene.camera import Camera
from goc.scene.priors import CapturePriors

UNLABELLED = -1
"""Id of a pixel nobody labelled: carries no loss and no vote (files say 255, or 65535 in 16 bits)."""

DepthKind = Literal["metric", "affine", "inverse"]
"""What stored depth D means. metric: z itself. affine: z = k·D + b, inverse: 1/z = k·D + b, with k > 0 and b
unknown and different in each view, as monocular networks estimate it."""

ROOM = 0
"""Id of walls, floor and ceiling; objects count from 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One view, decoded. All images have the camera's height and width."""

    camera: Camera
    image: UInt8[Tensor, "h w 3"]
    """sRGB as stored."""
    depth: Float[Tensor, "h w"] | None = None
    """z along the optical axis, scene units; NaN = none. As stored where the capture's `depth_kind` is not metric."""
    normals: Float[Tensor, "h w 3"] | None = None
    """Unit, camera axes, towards the camera (z < 0); NaN = none."""
    ids: Int16[Tensor, "h w"] | None = None
    """0 = room, 1… = objects, UNLABELLED (-1) = unknown."""


@runtime_checkable
class FrameSource(Protocol):
    """Where views come from: a function of the view's index, 0 ≤ index < number of views.

    Sources are built in layers, each a frozen dataclass that holds the layer below and its own data: paths, numbers,
    arrays, never a closure, so that a capture can be sent to another process (docs/decisions/0033). Their frames are
    shared by all who ask, and are not written into. They may be called from several threads.
    """

    def __call__(self, index: int) -> Frame:
        """One view, decoded or computed now or earlier."""
        ...


@dataclass(frozen=True, eq=False)
class StoredFrames:
    """Views that are in memory: the lowest layer of a capture that comes from arrays instead of files."""

    views: tuple[Frame, ...]

    def __call__(self, index: int) -> Frame:
        """One view."""
        return self.views[index]


@dataclass(frozen=True, kw_only=True, eq=False)
class PointCloud:
    """Coloured points, such as the sparse points of structure from motion."""

    positions: Float32[np.ndarray, "p 3"]
    colours: UInt8[np.ndarray, "p 3"]
    normals: Float32[np.ndarray, "p 3"] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Capture:
    """A set of posed views. Images are decoded by `frames` when asked for, through bounded caches.

    It can be pickled, and so sent to a worker process at every stage: without the images that were decoded.
    """

    cameras: tuple[Camera, ...]
    view_names: tuple[str, ...]
    """What errors and reports call each view: its image path inside the capture."""
    frames: FrameSource
    """Decodes or computes a view. Ask `capture[index]`, which counts negative indices from the end."""
    has_depth: bool
    """Some view has depth, of any kind; a single view may still lack it."""
    has_ids: bool
    depth_kind: DepthKind = "metric"
    """What the depth of all views means."""
    points: PointCloud | None = None
    id_names: dict[int, str] = field(default_factory=dict[int, str])
    """Names of ids where the capture gives them."""
    priors: CapturePriors | None = None
    """What `goc.priors.add_priors` found out; None before."""
    units_per_metre: float = 1.0
    """How many scene units make a metre: a length in metres times this is one in scene units. 1 where the capture is
    metric; otherwise a guess from the camera path, so that thresholds stated in metres mean something. The same words
    say what files store: a depth image of 1000 units per metre holds millimetres, whatever its format calls that."""
    metric: bool = True

    @property
    def has_metric_depth(self) -> bool:
        """Some view's depth is z in scene units, which can be measured in and fused."""
        return self.has_depth and self.depth_kind == "metric"

    def __len__(self) -> int:
        return len(self.cameras)

    def __getitem__(self, index: int) -> Frame:
        return self.frames(range(len(self))[index])

    def __iter__(self) -> Iterator[Frame]:
        return (self.frames(index) for index in range(len(self)))
