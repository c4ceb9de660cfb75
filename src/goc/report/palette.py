"""Colours for depth and ids."""

import numpy as np
from jaxtyping import Float, Int16, UInt8

from goc.scene import ROOM, UNLABELLED

# Near to far: bright yellow over magenta to dark violet, even steps of lightness.
_RAMP = np.array(
    [
        [252, 253, 191],
        [254, 202, 141],
        [253, 150, 104],
        [241, 96, 93],
        [205, 64, 113],
        [158, 47, 127],
        [114, 31, 129],
        [68, 15, 118],
        [20, 14, 54],
    ],
    np.float64,
)
_ROOM_COLOUR = (214, 212, 206)
_UNKNOWN_COLOUR = (52, 54, 60)
_GOLDEN = 0.618033988749895


def colour_of_id(number: int) -> tuple[int, int, int]:
    """The colour of an id in every picture: the room pale, unknown dark, objects in hues far from their neighbours'."""
    if number == ROOM:
        return _ROOM_COLOUR
    if number == UNLABELLED:
        return _UNKNOWN_COLOUR
    hue = 2 * np.pi * (0.08 + _GOLDEN * (number - 1))
    lightness, chroma = ((0.70, 0.145), (0.60, 0.135), (0.80, 0.115))[(number - 1) % 3]
    red, green, blue = _srgb_of_oklch(lightness, chroma, hue)
    return red, green, blue


def colours_of_ids(ids: Int16[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Picture an id image."""
    names, place = np.unique(ids, return_inverse=True)
    table = np.array([colour_of_id(int(name)) for name in names], np.uint8)
    return table[place.reshape(ids.shape)]


def colours_of_depth(depth: Float[np.ndarray, "h w"], near: float, far: float) -> UInt8[np.ndarray, "h w 3"]:
    """Picture z depth between `near` and `far`; what has none is dark grey."""
    share = np.clip((np.nan_to_num(depth, nan=near) - near) / max(far - near, 1e-9), 0.0, 1.0)
    place = share * (len(_RAMP) - 1)
    lower = np.minimum(place.astype(int), len(_RAMP) - 2)
    blended = _RAMP[lower] + (_RAMP[lower + 1] - _RAMP[lower]) * (place - lower)[..., None]
    blended[~np.isfinite(depth)] = _UNKNOWN_COLOUR
    return np.rint(blended).astype(np.uint8)


def _srgb_of_oklch(lightness: float, chroma: float, hue: float) -> tuple[int, int, int]:
    """OKLCH to 8-bit sRGB (Ottosson 2020), clipped."""
    a, b = chroma * np.cos(hue), chroma * np.sin(hue)
    roots = np.array([[0.3963377774, 0.2158037573], [-0.1055613458, -0.0638541728], [-0.0894841775, -1.2914855480]])
    long, medium, short = (lightness + roots @ (a, b)) ** 3
    linear = np.clip(
        [
            4.0767416621 * long - 3.3077115913 * medium + 0.2309699292 * short,
            -1.2684380046 * long + 2.6097574011 * medium - 0.3413193965 * short,
            -0.0041960863 * long - 0.7034186147 * medium + 1.7076147010 * short,
        ],
        0.0,
        1.0,
    )
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    red, green, blue = (round(float(255 * value)) for value in encoded)
    return red, green, blue
