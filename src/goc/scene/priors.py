"""What photographs and stored depth say of the surface before there are splats."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from goc.scene.camera import Camera


@dataclass(frozen=True, kw_only=True, eq=False)
class CoarseDepth:
    """Depth of one view on a raster of its own, coarser than the photograph."""

    camera: Camera
    """The view's camera, resized to the raster."""
    depth: Float[Tensor, "h w"]
    """z along the optical axis, scene units; NaN where nothing is known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturePriors:
    """Priors of the views of a capture. Views that are held out of the optimisation have none."""

    stereo: dict[int, CoarseDepth] | None = None
    """What other views confirm of each view's surface, by view index; None where photographs were not matched."""
    alignment: Float[Tensor, "n r"] | None = None
    """How the stored depth of each view of the capture becomes depth in scene units, a row a view, as
    `goc.geometry.monocular` lays it out; NaN = not aligned. None where depth is metric or absent."""
    settings: str = ""
    """What they were made with, as JSON: a stopped run goes on with the same settings only."""
