"""Do photographs agree with their poses? Where there is no depth, only the pictures themselves can tell.

Patches of one photograph are searched for in another along the lines on which poses say that they lie. With right
poses they are found better than patches from elsewhere are; with wrong ones just as badly.
"""

from dataclasses import dataclass

import numpy as np
import scipy.ndimage
import torch
from jaxtyping import Float64

from goc.capture.convention import inverse
from goc.scene import Capture

_SIDE_PX = 160
_PATCHES, _RADIUS, _STEPS = 60, 3, 48
_LEAST_TURN, _MOST_TURN, _BEST_TURN = np.radians([4.0, 25.0, 10.0])
_TEXTURE = 1.0
"""Least eigenvalue of a patch's structure tensor, (grey values a pixel)²; plain patches are found anywhere."""
_NEAREST = 0.12
"""Nearest depth that is searched, in distances between cameras and what they look at."""


@dataclass(frozen=True, eq=False)
class PhotoPair:
    """Two small grey photographs, and patches of the first."""

    first: int
    second: int
    """Among the views of the capture."""
    grey: Float64[np.ndarray, "h w"]
    """Of the second."""
    focal_px: Float64[np.ndarray, "2 2"]
    centre_px: Float64[np.ndarray, "2 2"]
    """Of the first and the second, for the small photographs."""
    places: Float64[np.ndarray, "p 2"]
    patches: Float64[np.ndarray, "p k"]
    """Of the first: mean 0, length 1."""


def photo_pairs(capture: Capture, poses: Float64[np.ndarray, "n 4 4"], count: int) -> tuple[PhotoPair, ...]:
    """Pairs of views that are turned by about 10° against each other, whichever way the poses are meant.

    The angle between two rotations is the same for inverted poses and in all camera axes.
    """
    made = []
    for first in np.unique(np.linspace(0, len(poses) - 1, count).round().astype(int)).tolist():
        cosine = (np.einsum("nij,ij->n", poses[:, :3, :3], poses[first, :3, :3]) - 1) / 2
        turns = np.arccos(cosine.clip(-1, 1))
        usable = (turns > _LEAST_TURN) & (turns < _MOST_TURN)
        if usable.any():
            near = np.abs(np.arange(len(poses)) - first)
            second = int(np.argmin(np.where(usable, np.abs(turns - _BEST_TURN) + 0.01 * near, np.inf)))
            made.append(_pair(capture, first, second))
    return tuple(pair for pair in made if len(pair.places) >= _PATCHES // 3)


def photo_agreement(pairs: tuple[PhotoPair, ...], poses: Float64[np.ndarray, "n 4 4"], distance: float) -> float:
    """How much better patches are found along their lines than patches of other places are.

    Args:
        pairs: of photographs.
        poses: world from camera of all views, OpenCV axes, read in some way.
        distance: typical depth in the unit of the poses.

    Returns:
        Mean difference of the best correlations: 0 where poses say nothing, 0.1 to 0.3 where they are right.
    """
    gains = [_gain(pair, inverse(poses[pair.second]) @ poses[pair.first], distance) for pair in pairs]
    known = [gain for gain in gains if np.isfinite(gain)]
    return float(np.mean(known)) if len(known) >= 2 else 0.0


def _pair(capture: Capture, first: int, second: int) -> PhotoPair:
    greys, focals, centres = [], [], []
    for row in (first, second):
        camera = capture.cameras[row]
        scale = _SIDE_PX / max(camera.width, camera.height)
        small = camera.resized(max(8, round(camera.width * scale)), max(8, round(camera.height * scale)))
        grey = capture[row].image.double().mean(2)[None, None]
        size = (small.height, small.width)
        greys.append(torch.nn.functional.interpolate(grey, size, mode="bilinear", antialias=True)[0, 0].numpy())
        focals.append(small.focal_px.double().numpy())
        centres.append(small.centre_px.double().numpy())
    places = _corners(greys[0])
    patches = _normalised(_windows(greys[0], places[:, None])[:, 0])
    return PhotoPair(first, second, greys[1], np.stack(focals), np.stack(centres), places, patches)


def _corners(grey: Float64[np.ndarray, "h w"]) -> Float64[np.ndarray, "p 2"]:
    """The pixel of each cell of a grid round which grey changes most, in both directions; plain cells have none."""
    down, across = np.gradient(grey)
    size = 2 * _RADIUS + 1
    xx, yy, xy = (scipy.ndimage.uniform_filter(each, size) for each in (across**2, down**2, across * down))
    strength = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    edge = 2 * _RADIUS
    strength[:edge] = strength[-edge:] = strength[:, :edge] = strength[:, -edge:] = 0
    side = int((grey.size / (1.5 * _PATCHES)) ** 0.5)
    found = []
    for top in range(0, grey.shape[0], side):
        for left in range(0, grey.shape[1], side):
            cell = strength[top : top + side, left : left + side]
            row, column = np.unravel_index(int(cell.argmax()), cell.shape)
            found.append((cell[row, column], left + column + 0.5, top + row + 0.5))
    best = sorted((one for one in found if one[0] > _TEXTURE), reverse=True)[:_PATCHES]
    return np.array([[x, y] for _, x, y in best]).reshape(-1, 2)


def _gain(pair: PhotoPair, second_from_first: Float64[np.ndarray, "4 4"], distance: float) -> float:
    """Mean best correlation of patches along their lines, less that of patches of other places."""
    rays = np.concatenate([(pair.places - pair.centre_px[0]) / pair.focal_px[0], np.ones((len(pair.places), 1))], 1)
    nearness = np.linspace(0.0, 1.0, _STEPS) / (_NEAREST * distance)
    points = (rays @ second_from_first[:3, :3].T)[:, None] + nearness[:, None] * second_from_first[:3, 3]
    z = np.where(points[..., 2:] > 1e-6, points[..., 2:], np.nan)
    pixels = points[..., :2] / z * pair.focal_px[1] + pair.centre_px[1]
    height, width = pair.grey.shape
    margin = _RADIUS + 1
    inside = ((pixels > margin) & (pixels < [width - margin, height - margin])).all(-1)
    enough = inside.sum(1) >= 4
    if enough.sum() < 10:
        return float("nan")
    windows = _normalised(_windows(pair.grey, np.where(inside[..., None], pixels, margin)))[enough]
    inside, own = inside[enough], pair.patches[enough]
    other = np.roll(own, len(own) // 2, axis=0)
    best = [np.where(inside, np.einsum("psk,pk->ps", windows, one), -1.0).max(1) for one in (own, other)]
    return float((best[0] - best[1]).mean())


def _windows(grey: Float64[np.ndarray, "h w"], pixels: Float64[np.ndarray, "p s 2"]) -> Float64[np.ndarray, "p s k"]:
    """Grey values of the square window round each place, between pixels linearly."""
    steps = np.arange(-_RADIUS, _RADIUS + 1)
    x = pixels[..., 0, None, None] - 0.5 + steps
    y = pixels[..., 1, None, None] - 0.5 + steps[:, None]
    x, y = np.broadcast_arrays(x, y)
    left = np.floor(x).astype(int).clip(0, grey.shape[1] - 2)
    top = np.floor(y).astype(int).clip(0, grey.shape[0] - 2)
    right, below = x - left, y - top
    upper = grey[top, left] * (1 - right) + grey[top, left + 1] * right
    lower = grey[top + 1, left] * (1 - right) + grey[top + 1, left + 1] * right
    return (upper * (1 - below) + lower * below).reshape(*pixels.shape[:2], -1)


def _normalised(windows: Float64[np.ndarray, "*b k"]) -> Float64[np.ndarray, "*b k"]:
    centred = windows - windows.mean(-1, keepdims=True)
    return centred / np.maximum(np.linalg.norm(centred, axis=-1, keepdims=True), 1e-6)
