"""Faults of photographs: motion blur and changing exposure."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float, UInt8

from goc.files.colour import decode_srgb, encode_srgb
from goc.settings import Range, Settings

Image = UInt8[np.ndarray, "h w 3"]


@dataclass(frozen=True, kw_only=True)
class ImageFaults(Settings):
    """Faults of photographs; 0 switches one off."""

    blur_px: Annotated[float, Range(least=0, most=200)] = 0.0
    """Root mean square length of the motion blur; each image has its own length and direction."""
    exposure_ev: Annotated[float, Range(least=0, most=5)] = 0.0
    """Standard deviation of the exposure, in stops: one stop doubles the light."""


def degrade_image(image: Image, config: ImageFaults, rng: np.random.Generator) -> Image:
    """An image with all faults: a random motion, both components normal, and a random exposure."""
    motion, stops = rng.standard_normal(2), float(rng.standard_normal())
    moved = motion_blur(decode_srgb(image), config.blur_px / np.sqrt(2) * motion)
    return encode_srgb(expose(moved, config.exposure_ev * stops))


def motion_blur(light: Float[np.ndarray, "h w 3"], motion_px: Float[np.ndarray, "2"]) -> Float[np.ndarray, "h w 3"]:
    """The mean of the image along a straight, even motion (x, y) while the shutter is open; beyond the rim, the rim."""
    weights = _track(motion_px)
    reach = len(weights) // 2
    height, width = light.shape[:2]
    padded = np.pad(light, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    total = np.zeros_like(light)
    for row, column in np.argwhere(weights > 0):
        total += weights[row, column] * padded[row : row + height, column : column + width]
    return total


def _track(motion_px: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k k"]:
    """Kernel of the motion: share of the exposure that falls on each pixel, from eight samples a pixel of length."""
    length = float(np.linalg.norm(motion_px))
    reach = int(np.ceil(length / 2)) + 1
    weights = np.zeros((2 * reach + 1, 2 * reach + 1))
    steps = int(np.ceil(8 * length)) + 1
    place = ((np.arange(steps) + 0.5) / steps - 0.5)[:, None] * motion_px[::-1] + reach
    low = np.floor(place).astype(int)
    for row in (0, 1):
        for column in (0, 1):
            share = np.abs(1 - np.array([row, column]) - (place - low)).prod(-1) / steps
            np.add.at(weights, (low[:, 0] + row, low[:, 1] + column), share)
    return weights


def expose(light: Float[np.ndarray, "h w 3"], stops: float) -> Float[np.ndarray, "h w 3"]:
    """Light times 2^stops; what is beyond white is cut off."""
    return np.clip(light * 2.0**stops, 0, 1)
