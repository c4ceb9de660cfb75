"""The result of stage 2: splats that know which object they belong to."""

from dataclasses import dataclass, field

from jaxtyping import Int16
from torch import Tensor

from goc.scene.gaussians import Gaussians


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstruction:
    """Capture → Reconstruction: the scene as labelled Gaussians."""

    gaussians: Gaussians
    labels: Int16[Tensor, "n"]
    """Object id of each splat: 0 = room, 1… = objects, UNLABELLED (-1) = never seen."""
    metrics: dict[str, float] = field(default_factory=dict[str, float])
    """How it was obtained and how well: held-out PSNR in dB, steps."""
