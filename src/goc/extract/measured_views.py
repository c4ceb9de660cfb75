"""Views for extraction: given depth where it deserves trust, else the splats' (docs/decisions/0037)."""

import itertools
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from goc.events import Listener, Progress, ignore
from goc.extract.agreement import (
    ONE_SURFACE,
    comparable_views,
    depth_gaps,
    measured_noise,
    typical_depth,
    view_gaps,
)
from goc.extract.rendered_views import DepthAndIds, RenderedFrames
from goc.fusion.detail import DepthNoise
from goc.scene import Camera
from goc.scene.cache import ViewCache
from goc.scene.capture import Capture, FrameSource

_KEPT_BYTES = 512 * 2**20
"""Chosen depth kept, all views together."""
_STEP = 4
"""Every how many pixels, across and down, errors are counted."""
_SURE = 3.0
"""Gaps above this many standard deviations are more than noise."""
_THROUGH = 0.02
"""Least share of the depth by which a view that sees through a surface sees past it: thin things are between pixels."""
_DRIFTING, _DRIFT = 4.0, 0.004
"""A view whose depth disagrees by so many times the capture's noise, and by this share of the depth, is not used."""
_FEWEST = 200
"""Compared pixels that such a judgement takes."""
_JUMP = 0.1
"""Neighbouring pixels whose depths differ by this share lie on two surfaces."""
_KEPT_JUMP = 0.7
"""Share of such a jump that depth shows within a window as wide as its edges are blurred."""
_BLURS = (1, 2, 4, 8)
"""Reaches of that window, pixels; the first is no blur."""
_EDGE_VIEWS = 12
"""Views in which edges are looked at."""
_RADIUS = 2
"""Of the window in which noise is averaged, pixels."""
_CLEAN = 0.1
"""Noise below this share of the pixel's footprint is left as it is: averaging would cost more than it gives."""


@dataclass(frozen=True, kw_only=True)
class DepthError:
    """How far the splats' depth is from the given one, on one object. Scene units."""

    median: float
    """Above 0: the splats lie behind."""
    mad: float
    """Median distance from that median."""
    pixels: int
    """That were compared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredViews:
    """What extraction looks at."""

    views: Capture
    """Photographs with the chosen depth. Ids are the splats', or given ones where splats show another surface."""
    metrics: dict[str, float]
    """What was measured of the given depth, for the report."""
    errors: dict[int, DepthError]
    """Of the splats' depth against the given one, by id."""


def measured_views(capture: Capture, shown: Capture, notify: Listener = ignore) -> MeasuredViews:
    """Choose, pixel by pixel, between the depth that a capture gives and that of its splats.

    Args:
        capture: as given; its depth counts where it is metric.
        shown: the same views with the splats' depth and ids (`rendered_views`).
        notify: hears progress.

    Returns:
        The views, and what was measured of the given depth. Without metric depth, or with too little
        overlap to tell how noisy it is, `shown` as it is.
    """
    if not capture.has_metric_depth:
        return MeasuredViews(views=shown, metrics={}, errors={})
    neighbours, compared = comparable_views(capture), []
    for index, around in enumerate(neighbours):
        compared.append(view_gaps(capture, index, around))
        notify(Progress(stage="compare depth", done=index + 1, total=len(capture)))
    noise, errors = measured_noise(compared), depth_errors(capture, shown)
    if noise is None:
        return MeasuredViews(views=shown, metrics={}, errors=errors)
    drifting = frozenset(view for view, pairs in enumerate(compared) if _drifts(pairs, noise))
    choice = DepthChoice(
        given=capture.frames,
        shown=shown.frames,
        cameras=capture.cameras,
        neighbours=neighbours,
        noise=noise,
        drifting=drifting,
        blur=edge_blur(capture, shown),
    )
    frames = RenderedFrames(below=shown.frames, drawn=ViewCache(choice, _KEPT_BYTES))
    metrics = {
        "given_depth_noise_m": float(noise.at(torch.tensor(typical_depth(capture)))) / capture.units_per_metre,
        "given_depth_views_left_out": float(len(drifting)),
    }
    return MeasuredViews(views=replace(shown, frames=frames), metrics=metrics, errors=errors)


def edge_blur(capture: Capture, shown: Capture) -> int:
    """How far from an edge given depth mixes two surfaces, pixels; 0 where its edges are sharp.

    A phone's lidar measures few points, and interpolates: views from one side agree in ramps that no surface has. Where
    the splats' depth jumps, the window is looked for in which the given depth changes as much.
    """
    kept: dict[int, list[Tensor]] = {reach: [] for reach in _BLURS}
    for index in range(0, len(capture), -(-len(capture) // _EDGE_VIEWS)):
        given, drawn = capture[index].depth, shown[index].depth
        if given is None or drawn is None:
            continue
        step = (drawn[:, 1:] - drawn[:, :-1]).abs()
        at = step > _JUMP * drawn[:, 1:]
        for reach in _BLURS:
            low, high = _range_near(torch.where(given > 0, given, torch.nan), reach)
            kept[reach].append(((high - low)[:, 1:] / step)[at])
    shares = {reach: torch.cat(parts) for reach, parts in kept.items() if parts}
    shares = {reach: share[share.isfinite()] for reach, share in shares.items()}
    sharp = [reach for reach, share in shares.items() if len(share) and share.median() >= _KEPT_JUMP]
    if len(shares) == 0 or all(len(share) < _FEWEST for share in shares.values()) or sharp[:1] == [_BLURS[0]]:
        return 0
    return 2 * (sharp[0] if sharp else _BLURS[-1]) + 1


def _range_near(depth: Float[Tensor, "h w"], reach: int) -> tuple[Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Least and greatest depth within `reach` pixels; NaN does not count."""
    least = torch.where(depth.isnan(), torch.inf, depth)[None, None]
    most = torch.where(depth.isnan(), -torch.inf, depth)[None, None]
    pool = torch.nn.MaxPool2d(2 * reach + 1, stride=1, padding=reach)
    return -pool(-least)[0, 0], pool(most)[0, 0]


def depth_errors(capture: Capture, shown: Capture) -> dict[int, DepthError]:
    """The splats' depth against the given one, by the capture's ids, or the splats' where it has none.

    Edges, where one shows another surface, do not count: medians.
    """
    found: dict[int, list[Tensor]] = {}
    for index in range(len(capture)):
        given, drawn = capture[index], shown[index]
        ids = drawn.ids if given.ids is None else given.ids
        if given.depth is None or drawn.depth is None or ids is None:
            continue
        error, ids = (drawn.depth - given.depth)[::_STEP, ::_STEP], ids[::_STEP, ::_STEP]
        valid = error.isfinite() & (ids >= 0)
        for number in torch.unique(ids[valid]).tolist():
            found.setdefault(int(number), []).append(error[valid & (ids == number)])
    return {number: _depth_error(torch.cat(parts)) for number, parts in sorted(found.items())}


def _depth_error(errors: Float[Tensor, "p"]) -> DepthError:
    median = errors.median()
    return DepthError(median=float(median), mad=float((errors - median).abs().median()), pixels=len(errors))


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthChoice:
    """Chooses the depth of a view, and the ids that belong to it."""

    given: FrameSource
    shown: FrameSource
    cameras: tuple[Camera, ...]
    neighbours: tuple[tuple[int, ...], ...]
    noise: DepthNoise
    drifting: frozenset[int]
    """Views whose depth does not fit to the others': the splats speak there."""
    blur: int
    """How far from the splats' edges given depth is not used, pixels."""

    def __call__(self, index: int) -> DepthAndIds:
        """One view's."""
        drawn, given = self.shown(index), self._given(index)
        shown = drawn.depth
        if shown is None:
            raise TypeError("the splats' views have depth")
        if given is None:
            return DepthAndIds(depth=shown, ids=drawn.ids)
        sigma = self.noise.at(given)
        trusted = given.isfinite() & self._unopposed(index, given, sigma)
        if self.blur:
            low, high = _range_near(shown.nan_to_num(0.0), self.blur)
            trusted &= high - low < _JUMP * high
        if _share_of_pixel(sigma, given, self.cameras[index]) >= _CLEAN:
            given = averaged(given, shown, trusted, _SURE * sigma)
        ids, own = drawn.ids, self.given(index).ids
        if ids is not None and own is not None:
            same = (given - shown).abs() < ONE_SURFACE * given
            ids = torch.where(trusted & ~same, own, ids)  # the splats' id is that of another surface
        return DepthAndIds(depth=torch.where(trusted, given, shown), ids=ids)

    def _given(self, index: int) -> Float[Tensor, "h w"] | None:
        depth = None if index in self.drifting else self.given(index).depth
        return None if depth is None else torch.where(depth > 0, depth, torch.nan)

    def _unopposed(self, index: int, given: Float[Tensor, "h w"], sigma: Float[Tensor, "h w"]) -> Bool[Tensor, "h w"]:
        """Pixels that no more views see through than see."""
        points = self.cameras[index].unproject_depth(given)
        reach = torch.maximum(_SURE * 2**0.5 * sigma, _THROUGH * given)
        balance = torch.zeros_like(given)
        for other in self.neighbours[index]:
            depth = self._given(other)
            if depth is not None:
                _, gap = depth_gaps(points, self.cameras[other], depth)
                balance += (gap.abs() <= reach).float() - (gap > reach).float()
        return balance >= 0


def averaged(
    given: Float[Tensor, "h w"],
    shown: Float[Tensor, "h w"],
    trusted: Bool[Tensor, "h w"],
    reach: Float[Tensor, "h w"],
) -> Float[Tensor, "h w"]:
    """Given depth with less noise: the splats' depth plus the mean, over 5 by 5 pixels, of the given one's distance.

    The splats' shape is smooth and their error changes slowly, so that the mean takes away noise and no shape. Only
    trusted pixels count whose difference is within `reach` of the pixel's own; where splats have no depth, nothing
    changes.
    """
    error = torch.where(trusted, given - shown, torch.nan)
    wide = torch.nn.functional.pad(error, (_RADIUS,) * 4, value=torch.nan)
    total, count = torch.zeros_like(given), torch.zeros_like(given)
    side = 2 * _RADIUS + 1
    for row, column in itertools.product(range(side), range(side)):
        near = wide[row : row + given.shape[0], column : column + given.shape[1]]
        alike = (near - error).abs() <= reach
        total += torch.where(alike, near, 0.0)
        count += alike
    return torch.where(count > 0, shown + total / count, given)


def _share_of_pixel(sigma: Float[Tensor, "h w"], depth: Float[Tensor, "h w"], camera: Camera) -> float:
    """Noise as a share of the side of a pixel on the surface: median of a view."""
    return float((sigma * camera.focal_px.to(depth).mean() / depth).nanmedian())


def _drifts(pairs: Float[Tensor, "2 _"], noise: DepthNoise) -> bool:
    """Whether the depth of a view is further from that of others than noise explains."""
    if pairs.shape[1] < _FEWEST:
        return False
    z, gap = pairs[0], pairs[1].abs()
    return bool((gap / noise.at(z)).median() > _DRIFTING and (gap / z).median() > _DRIFT)
