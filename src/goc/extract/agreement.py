"""How well the depth of views agrees: each pixel's surface, looked for in the depth of views from elsewhere."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import nnls
from torch import Tensor

from goc import _native
from goc.fusion.detail import DepthNoise
from goc.geometry.native_camera import native_camera
from goc.geometry.parallax import parallax_views
from goc.scene import Camera, Capture

ONE_SURFACE = 0.03
"""Neighbouring pixels whose depths differ by a smaller share lie on one surface."""
_COMPARABLE = 0.05
"""Gaps below this share of the depth are noise; beyond, one view sees another surface."""
_NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution, in medians of its absolute values."""
_NEIGHBOURS = 4
_BINS = 8
"""Ranges of depth that the noise is measured in."""
_FEWEST = 200
"""Pairs of pixels that a noise is measured from at least."""
_STEP = 4
"""Every how many pixels, across and down, views are compared."""
_SAMPLED = 32
"""Views that are enough to tell a capture's noise or its typical depth."""


def depth_gaps(
    points: Float[Tensor, "*b 3"], camera: Camera, depth: Float[Tensor, "h w"]
) -> tuple[Float[Tensor, "*b"], Float[Tensor, "*b"]]:
    """How far behind points a view's depth lies, along z: below 0 something hides them, above 0 it sees through them.

    Args:
        points: world; NaN allowed.
        camera: of the view.
        depth: its z, NaN = none.

    Returns:
        Gap to the surface between the four pixels round each point's, NaN where these are no single surface. Then the
        smallest gap to any of the four. Both NaN outside of the frame and where the view has no depth.
    """
    flat = points.reshape(-1, 3).float().contiguous().numpy()
    between, nearest = np.zeros((2, len(flat)), np.float32)
    seen = depth.float().contiguous().numpy()
    _native.depth_gaps(flat, native_camera(camera), seen, ONE_SURFACE, between, nearest)
    shape = points.shape[:-1]
    return torch.from_numpy(between).reshape(shape), torch.from_numpy(nearest).reshape(shape)


def comparable_views(views: Capture) -> tuple[tuple[int, ...], ...]:
    """Up to four views that see the surface of each view from elsewhere."""
    chosen = parallax_views(views.cameras, typical_depth(views), min(_NEIGHBOURS, max(1, len(views) - 1)))
    return tuple(tuple(int(other) for other in row if other >= 0) for row in chosen)


def views_noise(views: Capture) -> DepthNoise | None:
    """How noisy the depth of some views is, from how well others agree with it; None where that cannot be told."""
    if not views.has_metric_depth:
        return None
    neighbours = comparable_views(views)
    return measured_noise([view_gaps(views, index, neighbours[index]) for index in _some(views)])


def view_gaps(views: Capture, index: int, neighbours: tuple[int, ...]) -> Float[Tensor, "2 m"]:
    """Depth z of every fourth pixel each way, and its gap to each neighbour's depth, where both see one surface."""
    camera, depth = views.cameras[index], _positive(views, index)
    if depth is None:
        return torch.zeros(2, 0)
    z = depth[::_STEP, ::_STEP]
    row, column = torch.meshgrid(*(torch.arange(0, side, _STEP) + 0.5 for side in depth.shape), indexing="ij")
    points = camera.unproject(torch.stack([column, row], -1), z)
    found = [depth.new_zeros(2, 0)]
    for other in neighbours:
        measured = _positive(views, other)
        if measured is not None:
            gap, _ = depth_gaps(points, views.cameras[other], measured)
            kept = gap.abs() < _COMPARABLE * z
            found.append(torch.stack([z[kept], gap[kept]]))
    return torch.cat(found, -1)


def typical_depth(views: Capture) -> float:
    """Median depth of some views; 1 where there is none."""
    depths = [depth for depth in (_positive(views, index) for index in _some(views)) if depth is not None]
    medians = [depth.nanmedian() for depth in depths if depth.isfinite().any()]
    return float(torch.stack(medians).median()) if medians else 1.0


def _some(views: Capture) -> range:
    return range(0, len(views), -(-len(views) // _SAMPLED))


def _positive(views: Capture, index: int) -> Float[Tensor, "h w"] | None:
    depth = views[index].depth
    return None if depth is None else torch.where(depth > 0, depth, torch.nan)


def measured_noise(pairs: Sequence[Float[Tensor, "2 _"]]) -> DepthNoise | None:
    """Noise of one view's depth from the gaps of `view_gaps`; None where too few pixels were compared.

    Medians in ranges of depth, so that other surfaces and edges do not count; then the law of `DepthNoise` through
    them, by relative error. Both ends of a gap are noisy: it is wider than either by √2.
    """
    z, gap = torch.cat(list(pairs), -1).double().numpy() if pairs else np.zeros((2, 0))
    if len(z) < _FEWEST:
        return None
    order = np.argsort(z)
    parts = [part for part in np.array_split(order, _BINS) if len(part)]
    depth = np.array([np.median(z[part]) for part in parts])
    spread = np.array([np.median(np.abs(gap[part])) for part in parts]) * _NORMAL_MAD / np.sqrt(2)
    spread = np.maximum(spread, 1e-9 * depth)
    law, _ = nnls(np.stack([1 / spread, depth**2 / spread], 1), np.ones(len(parts)))
    return DepthNoise(floor=float(law[0]), square=float(law[1]))
