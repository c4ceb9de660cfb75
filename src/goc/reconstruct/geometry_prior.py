"""Depth and normals of a view, which the geometry losses compare rendered depth with."""

from collections.abc import Callable

import torch
from jaxtyping import Float, Int8
from torch import Tensor

from goc.geometry.monocular import SHAPE, aligned_frame, shape_of
from goc.geometry.normals import fitted_normals, fitting_radius
from goc.reconstruct.config import Monocular
from goc.reconstruct.losses import GeometryPrior, RenderedDepth
from goc.reconstruct.monocular import ALIGNMENT, refresh
from goc.scene.camera import Camera
from goc.scene.capture import Capture

_CACHE_BYTES = 256 * 2**20

ViewPrior = Callable[[int, dict[str, Tensor], RenderedDepth, int], GeometryPrior | None]
"""Arguments: index of the view, `State.views` (alignments in it may be refreshed in place), rendered depth, epoch."""


def geometry_priors(capture: Capture, with_normals: bool, monocular: Monocular) -> ViewPrior:
    """Make a function that returns depth and normals of a view; None where a view has neither.

    Normals come from the capture where it has them, else from planes fitted to the depth, in windows that grow with
    the depth's noise. Monocular depth is aligned first.
    """
    normals_of = FittedNormals()
    kind = capture.depth_kind

    def prior(view: int, views: dict[str, Tensor], shown: RenderedDepth, epoch: int) -> GeometryPrior | None:
        given = frame = capture[view]
        shape = 0.0
        if kind != "metric":
            row = views[ALIGNMENT][view]
            refresh(row, given, kind, shown, epoch, monocular)
            frame, shape = aligned_frame(given, row, kind), row[SHAPE].item()
        normals = frame.normals if with_normals else None
        if frame.depth is None:
            nothing = torch.full((1, *frame.image.shape[:2]), torch.nan)
            return None if normals is None else GeometryPrior(depth=nothing, normals=normals[None])
        if with_normals and normals is None:
            depth = frame.depth if kind == "metric" else shape_of(given, row, kind)
            normals = normals_of(view, shape, depth, frame.camera)
        return GeometryPrior(depth=frame.depth[None], normals=None if normals is None else normals[None])

    return prior


class FittedNormals:
    """Cache of fitted normals as signed bytes (steps of 0.4°), because fitting takes longer than half a training step.

    The first views stay when the budget is used up: steps visit all views in turn, so newer ones are no better.
    """

    def __init__(self, budget: int = _CACHE_BYTES) -> None:
        """Keep at most `budget` bytes."""
        self._budget, self._held = budget, 0
        self._kept: dict[int, tuple[float, Tensor]] = {}

    def __call__(self, view: int, shape: float, depth: Float[Tensor, "h w"], camera: Camera) -> Int8[Tensor, "h w 3"]:
        """Normals of a view's depth, camera axes, times 127; 0 0 0 = none. They are fitted again if `shape` changes."""
        if view in self._kept and self._kept[view][0] == shape:
            return self._kept[view][1]
        fitted = fitted_normals(depth, camera, fitting_radius(depth, camera))
        normals = torch.nan_to_num(fitted * 127.0).round().to(torch.int8)
        if view in self._kept or self._held + normals.numel() <= self._budget:
            self._held += 0 if view in self._kept else normals.numel()
            self._kept[view] = shape, normals
        return normals
