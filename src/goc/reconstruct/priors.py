"""What a view's geometry is compared with: its depth, and the normals of that depth."""

from collections import OrderedDict
from collections.abc import Callable

import torch
from torch import Tensor

from goc.geometry.normals import fitted_normals, fitting_radius
from goc.reconstruct.losses import GeometryPrior
from goc.scene.capture import Capture

_CACHE_BYTES = 256 * 2**20


def geometry_priors(capture: Capture, with_normals: bool) -> Callable[[int], GeometryPrior | None]:
    """Depth and normals of each view, on demand.

    Normals come from the capture where it has them, else from planes fitted to the depth, in windows that grow with
    the depth's noise. They are kept as signed bytes (0.4° steps) in a bounded cache: fitting takes longer than a step.
    """
    cache: OrderedDict[int, Tensor] = OrderedDict()

    def fitted(view: int) -> Tensor:
        if view in cache:
            cache.move_to_end(view)
        else:
            frame = capture[view]
            assert frame.depth is not None
            normals = fitted_normals(frame.depth, frame.camera, fitting_radius(frame.depth, frame.camera))
            cache[view] = torch.nan_to_num(normals * 127.0).round().to(torch.int8)
            while len(cache) > 1 and sum(kept.numel() for kept in cache.values()) > _CACHE_BYTES:
                cache.popitem(last=False)
        return cache[view]

    def prior(view: int) -> GeometryPrior | None:
        frame = capture[view]
        if frame.depth is None:
            return None
        normals = frame.normals if frame.normals is not None or not with_normals else fitted(view)
        return GeometryPrior(depth=frame.depth, normals=normals if with_normals else None)

    return prior
