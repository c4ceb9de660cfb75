"""Scale and offset that make a monocular depth image agree with known depths (suppl., "Depth Regularization")."""

import torch
from jaxtyping import Float
from torch import Tensor

from goc.scene.capture import DepthKind

_FEWEST = 24
"""Least number of pixels for a fit of scale and offset."""
_MOST = 2048
"""Greatest number of pixels that are fitted, evenly spread; more do not change the fit."""
_LEAST_VARIATION = 0.01
"""Least spread of the fitted depths, as a share of their mean: on a wall seen head-on, scale and offset are one."""
_LEAST_CORRELATION = 0.5
"""Least correlation of stored and known depth among the samples kept: below, they do not show the same scene."""
_ROUNDS = 10
_TUKEY = 4.685
"""Tukey's biweight is 95 % as efficient as least squares on normal errors with this many standard deviations."""
_SIGMA_OF_MAD = 1.4826
_EXACT = 1e-5
"""Relative errors below are rounding, and no reason to reject anything."""


def align(
    stored: Float[Tensor, "p"],
    depth: Float[Tensor, "p"],
    kind: DepthKind,
    weights: Float[Tensor, "p"] | None = None,
) -> Float[Tensor, "2"] | None:
    """Fit k, b: argmin Σ ρ((k·D̂ + b - D) / D), over the samples that are finite in both and positive in `depth`.

    The paper's Eq. for k̂, b̂ has plain squares. Three departures (docs/decisions/0024). ρ is Tukey's
    biweight, its scale the median absolute deviation, so that occluded points, blurred edges and surface that is not
    there yet do not bend the fit. Errors are relative, as those of monocular depth are; for kind inverse, those of 1/z.
    And the line is the reduced major axis, k = σ(D) / σ(D̂): both sides are noisy, least squares would flatten the scene
    a little, and again at each refresh. It starts from the median of pairwise slopes (Theil 1950, Sen 1968), which up
    to 29 % outliers of any size cannot spoil. Twin: tests/oracles/alignment.py.

    Args:
        stored: D̂ as stored.
        depth: D, z, scene units.
        kind: affine or inverse; of metric depth too, to measure it.
        weights: trust in each sample, ≥ 0; 1 if None.

    Returns:
        (k, b); None where nothing is to be learned: fewer than 24 samples, (almost) the same depth in all of them,
        little correlation, or depth that is not positive for most samples, which no network means.
    """
    known = torch.isfinite(stored) & torch.isfinite(depth) & (depth > 0)
    if weights is not None:
        known &= weights > 0
    rows = torch.nonzero(known)[:, 0]
    if len(rows) < _FEWEST:
        return None
    rows = rows[:: -(-len(rows) // _MOST)]
    x, z = stored[rows].double(), depth[rows].double()
    y = 1.0 / z if kind == "inverse" else z
    trust = y.square().reciprocal() if weights is None else weights[rows].double() / y.square()
    line = _pairwise(x, y)
    for _ in range(_ROUNDS):
        error = ((line[0] * x + line[1]) / y - 1.0).abs()
        sigma = _SIGMA_OF_MAD * error.median().item() + _EXACT
        biweight = (1.0 - (error / (_TUKEY * sigma)).square()).clamp_min(0.0).square()
        line, previous = _solved(x, y, trust * biweight), line
        if line is None:
            return None
        if (line - previous).abs().max() <= 1e-6 * line.abs().max():
            break
    fitted = line[0] * x + line[1]
    varies = line[0] * (x.quantile(0.95) - x.quantile(0.05)) > _LEAST_VARIATION * fitted.median()
    return line.float() if line[0] > 0 and fitted.median() > 0 and varies else None


CELLS = 12
"""Side of the grid on which a view's slow errors are kept."""
_RIDGE = 0.05
"""Share of a cell's pixels that say there is no error, against the few that say otherwise."""


def slow_errors(known: Float[Tensor, "r c"], aligned: Float[Tensor, "r c"]) -> Float[Tensor, "12 12"]:
    """The smooth part of known / aligned - 1: what networks get wrong beyond one scale and one offset.

    Means over the cells of a grid, blurred over neighbouring cells and drawn towards 0 where little is known; samples
    far from that surface are rejected (Tukey, three rounds). Locally weighted alignment, as in Xu et al. (2022).
    """
    ratio = known / aligned - 1.0
    there = torch.isfinite(ratio)
    if int(there.sum()) < _FEWEST:
        return torch.zeros(CELLS, CELLS)
    ratio = torch.where(there, ratio, 0.0)
    field = torch.zeros(CELLS, CELLS)
    for _ in range(3):
        error = (ratio - spread(field, *ratio.shape)).abs()
        sigma = _SIGMA_OF_MAD * error[there].median() + _EXACT
        weight = (1.0 - (error / (_TUKEY * sigma)).square()).clamp_min(0.0).square() * there
        field = cell_means(weight * ratio) / (cell_means(weight) + _RIDGE)
    return field


def spread(field: Float[Tensor, "r c"], height: int, width: int) -> Float[Tensor, "h w"]:
    """The field of a grid at every pixel, bilinearly."""
    size = (height, width)
    return torch.nn.functional.interpolate(field[None, None], size, mode="bilinear", align_corners=False)[0, 0]


def cell_means(image: Float[Tensor, "h w"]) -> Float[Tensor, "12 12"]:
    """Means over the cells of the grid, then a binomial blur of five cells."""
    cells = torch.nn.functional.adaptive_avg_pool2d(image[None, None], CELLS)
    taps = torch.tensor([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
    return torch.nn.functional.conv2d(cells, torch.outer(taps, taps)[None, None], padding=2)[0, 0]


def aligned_depth(stored: Float[Tensor, "h w"], line: Float[Tensor, "2"], kind: DepthKind) -> Float[Tensor, "h w"]:
    """z, scene units, of depth as stored and its (k, b); NaN where there is none, or none before the camera."""
    fitted = line[0] * stored + line[1]
    fitted = torch.where(fitted > 0, fitted, torch.nan)
    return 1.0 / fitted if kind == "inverse" else fitted


def _pairwise(x: Float[Tensor, "p"], y: Float[Tensor, "p"]) -> Float[Tensor, "2"]:
    """Line of the median slope between samples half the ranks of x apart, and of the median offset."""
    order = x.argsort(stable=True)
    half = len(x) // 2
    near, far = order[:half], order[len(x) - half :]
    run = x[far] - x[near]
    slope = torch.where(run > 0, (y[far] - y[near]) / run.clamp_min(1e-300), 0.0).median()
    return torch.stack([slope, (y - slope * x).median()])


def _solved(x: Float[Tensor, "p"], y: Float[Tensor, "p"], weights: Float[Tensor, "p"]) -> Float[Tensor, "2"] | None:
    """Reduced major axis of weighted samples, about their means; None where x and y have little in common."""
    total = weights.sum()
    if not total > 0:
        return None
    mean_x, mean_y = (weights * x).sum() / total, (weights * y).sum() / total
    across, along = x - mean_x, y - mean_y
    variance_x, variance_y = (weights * across.square()).sum(), (weights * along.square()).sum()
    if not variance_x > 1e-14 * total * (mean_x.square() + 1e-300):
        return None
    if not (weights * across * along).sum() > _LEAST_CORRELATION * (variance_x * variance_y).sqrt():
        return None
    slope = (variance_y / variance_x).sqrt()
    return torch.stack([slope, mean_y - slope * mean_x])
