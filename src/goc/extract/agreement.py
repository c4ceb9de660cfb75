"""How well the depth of views agrees: each pixel's surface, looked for in the depth of views from elsewhere."""

from collections.abc import Iterable, Sequence

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import nnls
from torch import Tensor

from goc.fusion.detail import DepthNoise
from goc.geometry.parallax import parallax_views
from goc.scene import Camera, Capture

_ONE_SURFACE = 0.03
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
    pixels, z = camera.project(points)
    place = pixels - 0.5
    corner = place.nan_to_num(-1.0).floor()
    inside = (corner >= 0).all(-1) & (corner[..., 0] < camera.width - 1) & (corner[..., 1] < camera.height - 1)
    x, y = torch.where(inside[..., None], corner, 0.0).long().unbind(-1)
    first, flat = y * camera.width + x, depth.reshape(-1)
    four = torch.stack([flat[first + step] for step in (0, 1, camera.width, camera.width + 1)], -1)
    share_x, share_y = (place - corner).unbind(-1)
    weights = [(1 - share_x) * (1 - share_y), share_x * (1 - share_y), (1 - share_x) * share_y, share_x * share_y]
    smooth = 1.0 / (torch.stack(weights, -1) / four).sum(-1)  # planes are linear in 1/z
    single = four.amax(-1) - four.amin(-1) < _ONE_SURFACE * smooth  # NaN is no surface
    between = torch.where(inside & single, smooth - z, torch.nan)
    each = torch.where(inside[..., None], four - z[..., None], torch.nan)
    nearest = torch.where(each.isnan(), torch.inf, each.abs()).min(-1, keepdim=True).indices
    return between, torch.where(between.isnan(), each.gather(-1, nearest)[..., 0], between)


def comparable_views(views: Capture, distance: float) -> tuple[tuple[int, ...], ...]:
    """Up to four views that see the surface of each view from elsewhere; `distance` is the scene's typical depth."""
    chosen = parallax_views(views.cameras, distance, min(_NEIGHBOURS, max(1, len(views) - 1)))
    return tuple(tuple(int(other) for other in row if other >= 0) for row in chosen)


def disagreement(
    depth: Float[Tensor, "h w"], camera: Camera, others: Iterable[tuple[Camera, Float[Tensor, "h w"]]], step: int
) -> Float[Tensor, "2 m"]:
    """Depth z of every `step`-th pixel each way, and its gap to each other view's, where both see one surface."""
    z = depth[::step, ::step]
    points = camera.unproject_depth(depth)[::step, ::step]
    found = []
    for other, measured in others:
        gap, _ = depth_gaps(points, other, measured)
        kept = gap.abs() < _COMPARABLE * z
        found.append(torch.stack([z[kept], gap[kept]]))
    return torch.cat(found, -1) if found else depth.new_zeros(2, 0)


def measured_noise(pairs: Sequence[Float[Tensor, "2 _"]]) -> DepthNoise | None:
    """Noise of one view's depth from the gaps of `disagreement`; None where too few pixels were compared.

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
