"""The views that are aligned with each other, and how a round looks at them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from goc.align.images import AlignedView, Samples, coarse_view, least_shrink, samples_of
from goc.align.pairs import compared_views
from goc.align.system import Look
from goc.scene.capture import Capture

OTHERS = 8
"""Views that each one is compared with."""
_FINE, _COARSE = 52, 26
"""Points that are compared, across and down a view: once cameras are nearly right, and before."""
BLURS = (4.0, 4.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0)
"""Blur of the photographs in each round, pixels of an image that is 320 wide: fine detail leads only from near."""
_REACH_M = (0.08, 0.06, 0.05, 0.05, 0.04, 0.04, 0.04, 0.04)
"""Gaps beyond are of other surfaces, in each round."""
FIRST_GAP_M = 0.01
"""Standard deviation of gaps before any was seen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewSet:
    """Some views of a capture, by rows."""

    images: list[AlignedView | None]
    poses: Float64[np.ndarray, "v 4 4"]
    """World from camera, as given."""
    others: list[list[int]]
    """Rows of the views that each one is compared with, all of them of those that may be looked at."""
    train: Bool[np.ndarray, "v"]
    """Which may be looked at; the others are held out."""
    typical: float
    """Median depth, scene units."""
    unit: float
    """Scene units in a metre."""

    def samples(self, round_: int, which: Bool[np.ndarray, "v"]) -> list[Samples | None]:
        """Points of some views that a round compares."""
        across = _FINE if BLURS[round_] <= 1.0 else _COARSE
        chosen = zip(self.images, which, strict=True)
        return [None if view is None or not on else samples_of(view, across) for view, on in chosen]

    def look(self, round_: int, gap: float) -> Look:
        """How a round compares; `gap` in scene units."""
        return Look(blur_px=BLURS[round_], reach=_REACH_M[round_] * self.unit, gap=gap, typical=self.typical)


def view_set(
    capture: Capture, views: Sequence[int], train: Bool[np.ndarray, "v"], images: dict[int, AlignedView | None]
) -> ViewSet:
    """Images of some views of a capture, and which of them are compared; `images` keeps those that were made."""
    fewest = least_shrink(capture)
    for view in views:
        if view not in images:
            images[view] = coarse_view(capture, view, fewest)
    made = [images[view] for view in views]
    poses = np.stack([capture.cameras[view].world_from_cam.double().numpy() for view in views])
    known = np.array([view is not None for view in made])
    depths = [float(np.nanmedian(view.depth)) for view in made if view is not None and np.isfinite(view.depth).any()]
    return ViewSet(
        images=made,
        poses=poses,
        others=compared_views(made, poses, OTHERS, train & known),
        train=train,
        typical=float(np.median(depths)) if depths else 1.0,
        unit=capture.units_per_metre,
    )
