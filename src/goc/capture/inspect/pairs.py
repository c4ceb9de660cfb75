"""Points that two views share: what each of them says of depth, brightness and id there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.ndimage
import torch
from jaxtyping import Bool, Float64, Int16

from goc.capture.inspect.looks import Look

_STEPS = (1, 2, 4)
"""Distances, in views, of those that a view is compared with."""
_NEAR = 0.06
"""Relative difference of depth beyond which two views do not see the same surface."""
_SMOOTH = 0.04
"""Relative change of depth over three pixels, beyond which a pixel is at an edge or on a slanted surface."""
_FEWEST = 40


@dataclass(frozen=True, eq=False)
class Shared:
    """Pixels of one view, found in another one."""

    here: int
    there: int
    """Rows of the looks."""
    gap: Float64[np.ndarray, "p"]
    """Depth in the other view less what it should be, scene units."""
    stops: float
    """How much brighter the other view is, in stops (factors of two); NaN where that cannot be told."""
    own: Int16[np.ndarray, "p"] | None
    other: Int16[np.ndarray, "p"] | None
    """Ids in this and the other view, where both have ids."""


def shared_points(looks: Sequence[Look]) -> Iterator[Shared]:
    """Compare each view with some before and after it; only those with depth."""
    for here in range(len(looks)):
        for step in _STEPS:
            for there in (here - step, here + step):
                if 0 <= there < len(looks):
                    found = _compare(looks, here, there)
                    if found is not None:
                        yield found


def _compare(looks: Sequence[Look], here: int, there: int) -> Shared | None:
    a, b = looks[here], looks[there]
    if a.depth is None or b.depth is None:
        return None
    points = a.small.unproject_depth(torch.from_numpy(np.where(_inner(a), a.depth, np.nan)))
    pixels, z = b.small.project(points)
    size = torch.tensor([b.small.width, b.small.height])
    inside = ((pixels >= 0) & (pixels < size)).all(-1).numpy()
    x, y = pixels[torch.from_numpy(inside)].long().numpy().T
    expected, found = z.numpy()[inside], b.depth[y, x]
    near = (np.abs(found / expected - 1) < _NEAR) & _inner(b)[y, x]
    if near.sum() < _FEWEST:
        return None
    own = None if a.ids is None else a.ids[inside][near]
    other = None if b.ids is None else b.ids[y, x][near]
    dark, bright = a.grey[inside][near], b.grey[y, x][near]
    usable = (np.minimum(dark, bright) > 0.005) & (np.maximum(dark, bright) < 0.9)
    stops = float(np.median(np.log2(bright[usable] / dark[usable]))) if usable.sum() >= _FEWEST else float("nan")
    both = own is not None and other is not None
    return Shared(here, there, (found - expected)[near], stops, own if both else None, other if both else None)


@lru_cache(maxsize=64)
def _inner(look: Look) -> Bool[np.ndarray, "r c"]:
    """Pixels in the middle of a surface and of a label: what rounding to pixels changes, proves nothing."""
    assert look.depth is not None
    high = scipy.ndimage.maximum_filter(np.nan_to_num(look.depth, nan=np.inf), 3)
    low = scipy.ndimage.minimum_filter(np.nan_to_num(look.depth, nan=-np.inf), 3)
    inner = high - low < _SMOOTH * look.depth
    if look.ids is not None:
        inner &= scipy.ndimage.maximum_filter(look.ids, 3) == scipy.ndimage.minimum_filter(look.ids, 3)
    return inner
