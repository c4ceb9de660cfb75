"""Undistortion: which pinhole view a lens becomes, and where each of its pixels is found in the stored image.

The pinhole keeps the lens's focal lengths; borders that no stored pixel covers are cropped, so that no black frame is
ever taken for a measurement. A lens that sees more than one pinhole can becomes several views (docs/decisions/0043).
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64, Shaped
from torch import Tensor

from goc.capture.lens import Lens
from goc.capture.projection import bend
from goc.errors import CaptureError

_LEAST_SHARE = 0.25
_BLOCK_ROWS = 128
_WIDEST_DEG = 60.0
"""A pinhole sees no farther from its axis, across or down: at 60° it already needs four times the axis's pixels."""
_SPLIT_DEG = 70.0
"""A lens that sees this far from its axis, across or down, becomes the faces of a cube."""
_FACES = {
    "front": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "right": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "back": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "left": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "up": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "down": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
}
"""lens_from_cam of the faces of a cube, by rows."""
Box = tuple[int, int, int, int]
"""left, top, right, bottom of what is kept, in pixels of the pinhole's raster."""


@dataclass(frozen=True)
class Pinhole:
    """Intrinsics of a view without distortion; pixel (0, 0) is centred at (0.5, 0.5)."""

    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    width: int
    height: int

    def resized(self, width: int, height: int) -> "Pinhole":
        """The same view on a raster of another size."""
        across, down = width / self.width, height / self.height
        focal = (self.focal_px[0] * across, self.focal_px[1] * down)
        return Pinhole(focal, (self.centre_px[0] * across, self.centre_px[1] * down), width, height)

    def rays(self, rows: range) -> Float64[np.ndarray, "rows w 3"]:
        """Directions with z = 1 through the pixel centres of some rows."""
        x = (np.arange(self.width) + 0.5 - self.centre_px[0]) / self.focal_px[0]
        y = (np.arange(rows.start, rows.stop) + 0.5 - self.centre_px[1]) / self.focal_px[1]
        return np.stack(np.broadcast_arrays(x, y[:, None], 1.0), -1)


def distort(lens: Lens, directions: Float64[np.ndarray, "*shape 2"]) -> Float64[np.ndarray, "*shape 2"]:
    """Map undistorted directions (x / z, y / z) to the lens's plane."""
    return bend(lens, np.concatenate([directions, np.ones_like(directions[..., :1])], -1))


@lru_cache(maxsize=4096)
def pinhole_of(lens: Lens) -> Pinhole:
    """The pinhole view that a lens becomes: all of it is covered by stored pixels.

    Raises:
        CaptureError: next to nothing would be left, so the coefficients cannot be right.
    """
    whole = _uncropped(lens)
    left, top, right, bottom = kept_box(lens)
    centre = (whole.centre_px[0] - left, whole.centre_px[1] - top)
    return Pinhole(whole.focal_px, centre, right - left, bottom - top)


@lru_cache(maxsize=4096)
def kept_box(lens: Lens) -> Box:
    """The part of the uncropped pinhole's raster that stored pixels cover; raises what `pinhole_of` raises."""
    if lens.is_pinhole:
        return 0, 0, lens.width, lens.height
    whole = _uncropped(lens)
    left, top, right, bottom = box = _shrink(_covered(lens, whole))
    if (right - left) * (bottom - top) < _LEAST_SHARE * whole.width * whole.height:
        raise CaptureError(f"distortion {lens.radial} {lens.tangential} leaves next to nothing of the image")
    return box


@lru_cache(maxsize=16)  # 8 bytes a pixel of a view; captures nearly always share one lens, or the six faces of one
def sampling_grid(lens: Lens, view: Pinhole | None = None) -> Float32[Tensor, "h w 2"]:
    """Where to look in the stored image for each pixel of a pinhole view along the lens's axis or turn.

    Args:
        lens: of the stored image.
        view: `pinhole_of(lens)` if None.

    Returns:
        In the units of `grid_sample`: -1 and 1 are the edges; 3 where the lens sees nothing.
    """
    view = view or pinhole_of(lens)
    grid = np.zeros((view.height, view.width, 2), np.float32)
    for rows in _blocks(view.height):
        source = _source_px(lens, view.rays(rows)) / [lens.width, lens.height] * 2 - 1
        grid[rows.start : rows.stop] = np.where(np.abs(source) < 3, source, 3)
    return torch.from_numpy(grid)


def looks_of(lens: Lens) -> dict[str, Lens]:
    """The views that a lens is cut into, by name: itself under "", or turned to the faces of a cube that it sees."""
    if lens.projection == "perspective" or lens.turn is not None or max(_reaches_deg(lens)) < _SPLIT_DEG:
        return {"": lens}
    faces = {name: replace(lens, turn=tuple(map(float, np.ravel(rows)))) for name, rows in _FACES.items()}
    return {name: face for name, face in faces.items() if _sees_enough(face)}


def _sees_enough(face: Lens) -> bool:
    try:
        kept_box(face)
    except CaptureError:
        return False
    return True


@lru_cache(maxsize=4096)
def _uncropped(lens: Lens) -> Pinhole:
    """The pinhole with the lens's focal lengths that sees all that it sees, within bounds."""
    if lens.projection == "perspective" and lens.turn is None:
        return Pinhole(lens.focal_px, lens.centre_px, lens.width, lens.height)
    reaches = [45.0] * 4 if lens.turn is not None else [min(reach, _WIDEST_DEG) for reach in _reaches_deg(lens)]
    left, right, up, down = (math.tan(math.radians(max(reach, 1.0))) for reach in reaches)
    width, height = (left + right) * lens.focal_px[0], (up + down) * lens.focal_px[1]
    scale = min(1.0, math.sqrt(lens.width * lens.height / (width * height)))  # no more pixels than there are
    focal = (lens.focal_px[0] * scale, lens.focal_px[1] * scale)
    size = max(2, round(width * scale)), max(2, round(height * scale))
    return Pinhole(focal, (left * focal[0], up * focal[1]), *size)


@lru_cache(maxsize=4096)
def _reaches_deg(lens: Lens) -> tuple[float, float, float, float]:
    """How far from its axis a lens sees to the left, right, up and down."""
    angles = np.radians(np.arange(1.0, 121.0))
    ahead, aside, nought = np.cos(angles), np.sin(angles), np.zeros_like(angles)
    reaches = []
    for rays in ((-aside, nought), (aside, nought), (nought, -aside), (nought, aside)):
        seen = _inside(lens, _source_px(lens, np.stack([*rays, ahead], -1)))
        reaches.append(float(seen.argmin()) if not seen.all() else float(len(angles)))
    return tuple(reaches)


def _blocks(height: int) -> list[range]:
    """Rows in portions: a large photograph in double precision would take gigabytes."""
    return [range(start, min(start + _BLOCK_ROWS, height)) for start in range(0, height, _BLOCK_ROWS)]


def _source_px(lens: Lens, rays: Float64[np.ndarray, "*shape 3"]) -> Float64[np.ndarray, "*shape 2"]:
    with np.errstate(over="ignore", invalid="ignore"):  # absurd coefficients: _covered leaves nothing of such a view
        return bend(lens, rays) * lens.focal_px + lens.centre_px


def _inside(lens: Lens, source: Float64[np.ndarray, "*shape 2"]) -> Bool[np.ndarray, "*shape"]:
    """Whether places in the stored image show something; False for NaN."""
    margin = lens.margin_px
    beyond = (source < margin) | (source > [lens.width - margin, lens.height - margin]) | np.isnan(source)
    if lens.circle_px is not None:
        beyond[..., 0] |= np.hypot(*np.moveaxis(source - lens.centre_px, -1, 0)) > lens.circle_px
    return ~(beyond[..., 0] | beyond[..., 1])


def _covered(lens: Lens, view: Pinhole) -> Bool[np.ndarray, "h w"]:
    """Pixels of a view whose source the stored image shows."""
    covered = np.zeros((view.height, view.width), bool)
    for rows in _blocks(view.height):
        covered[rows.start : rows.stop] = _inside(lens, _source_px(lens, view.rays(rows)))
    return covered


def _shrink(covered: Bool[np.ndarray, "h w"]) -> Box:
    """Drop the border line with the largest uncovered share, until all four borders are covered."""
    top, left = 0, 0
    bottom, right = covered.shape
    while top < bottom and left < right:
        kept = covered[top:bottom, left:right]
        lines: tuple[Shaped[np.ndarray, "line"], ...] = (kept[:, 0], kept[0], kept[:, -1], kept[-1])
        gaps = [1 - line.mean() for line in lines]
        worst = int(np.argmax(gaps))
        if gaps[worst] == 0:
            break
        left += worst == 0
        top += worst == 1
        right -= worst == 2
        bottom -= worst == 3
    return left, top, right, bottom
