"""Undistortion: where each pixel of a pinhole view is found in the stored image.

The model maps undistorted to distorted directions in closed form (OpenCV's, Brown 1966), which is the way a remap
needs it. The pinhole keeps the focal lengths; borders that no stored pixel covers are cropped, so that no black frame
is ever taken for a measurement.
"""

from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64, Shaped
from torch import Tensor

from goc.capture.source import Lens
from goc.errors import CaptureError

_LEAST_SHARE = 0.25
_BLOCK_ROWS = 128
Box = tuple[int, int, int, int]
"""left, top, right, bottom of what is kept, in pixels of the stored raster."""


def distort(lens: Lens, directions: Float64[np.ndarray, "*shape 2"]) -> Float64[np.ndarray, "*shape 2"]:
    """Map undistorted to distorted directions (x / z, y / z)."""
    x, y = directions[..., 0], directions[..., 1]
    square = x * x + y * y
    k1, k2, k3, k4 = lens.radial
    p1, p2 = lens.tangential
    stretch = 1 + square * (k1 + square * (k2 + square * (k3 + square * k4)))
    bent_x = x * stretch + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    bent_y = y * stretch + p1 * (square + 2 * y * y) + 2 * p2 * x * y
    return np.stack([bent_x, bent_y], -1)


@lru_cache(maxsize=4096)
def kept_box(lens: Lens) -> Box:
    """The part of the raster that stored pixels cover after undistortion.

    Raises:
        CaptureError: next to nothing would be left, so the coefficients cannot be right.
    """
    if lens.is_pinhole:
        return 0, 0, lens.width, lens.height
    left, top, right, bottom = box = _shrink(_covered(lens))
    if (right - left) * (bottom - top) < _LEAST_SHARE * lens.width * lens.height:
        raise CaptureError(f"distortion {lens.radial} {lens.tangential} leaves next to nothing of the image")
    return box


@lru_cache(maxsize=2)  # a grid is 8 bytes a pixel; captures nearly always share one
def sampling_grid(lens: Lens) -> Float32[Tensor, "h w 2"]:
    """Where to look in the stored image for each kept pixel, in the units of `grid_sample` (-1 and 1 are its edges)."""
    left, top, right, bottom = kept_box(lens)
    grid = np.zeros((bottom - top, right - left, 2), np.float32)
    for rows in _blocks(top, bottom):
        source = _source_px(lens, _directions(lens, rows)[:, left:right])
        grid[rows.start - top : rows.stop - top] = source / [lens.width, lens.height] * 2 - 1
    return torch.from_numpy(grid)


def _blocks(top: int, bottom: int) -> list[range]:
    """Rows in portions: a large photograph in double precision would take gigabytes."""
    return [range(start, min(start + _BLOCK_ROWS, bottom)) for start in range(top, bottom, _BLOCK_ROWS)]


def _directions(lens: Lens, rows: range) -> Float64[np.ndarray, "rows w 2"]:
    x = (np.arange(lens.width) + 0.5 - lens.centre_px[0]) / lens.focal_px[0]
    y = (np.arange(rows.start, rows.stop) + 0.5 - lens.centre_px[1]) / lens.focal_px[1]
    return np.stack(np.meshgrid(x, y), -1)


def _source_px(lens: Lens, directions: Float64[np.ndarray, "rows w 2"]) -> Float64[np.ndarray, "rows w 2"]:
    with np.errstate(over="ignore", invalid="ignore"):  # absurd coefficients: _covered leaves nothing of such a view
        return distort(lens, directions) * lens.focal_px + lens.centre_px


def _covered(lens: Lens) -> Bool[np.ndarray, "h w"]:
    """Pixels whose source lies in the stored image, on the near side of where the radial model folds back."""
    fold = _fold(lens)
    covered = np.zeros((lens.height, lens.width), bool)
    for rows in _blocks(0, lens.height):
        directions = _directions(lens, rows)
        source = _source_px(lens, directions)
        inside = ((source >= 0) & (source <= [lens.width, lens.height])).all(-1)  # False for NaN
        covered[rows.start : rows.stop] = inside & ((directions**2).sum(-1) < fold)
    return covered


def _fold(lens: Lens) -> float:
    """Smallest squared radius where the distorted radius stops growing; infinity if it never does."""
    slope = [(2 * order + 1) * k for order, k in enumerate((1.0, *lens.radial))]
    roots = np.roots(slope[::-1])
    real = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].real
    return float(real.min()) if len(real) else float("inf")


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
