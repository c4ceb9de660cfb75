"""Simulated output of a monocular network: depth up to an unknown scale and offset, normals a few degrees off."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import scipy.ndimage
import torch
from jaxtyping import Float, UInt16

from goc.geometry.normals import fitted_normals
from goc.scene import Camera
from goc.settings import Range, Settings

Depth = Float[np.ndarray, "h w"]
Normals = Float[np.ndarray, "h w 3"]
"""Unit, OpenCV camera axes; NaN = none."""
Rng = np.random.Generator

_TOP = 65535
_WAVES = 5
"""Cells of the low-frequency errors along each side of the image."""


@dataclass(frozen=True, kw_only=True)
class MonocularDepth(Settings):
    """Errors of monocular depth networks. All but the unknown scale and offset can be switched off with 0."""

    kind: Literal["affine", "inverse"] = "affine"
    """What the stored value D is in proportion to, up to an offset: z = k D + b, or 1/z = k D + b."""
    margin: Annotated[float, Range(least=0, most=10)] = 0.3
    """The values of an image use between 1 / (1 + twice this) of the 16 bits and all of them, so that neither their
    lowest nor their highest value tells a depth."""
    waves: Annotated[float, Range(least=0, most=0.3)] = 0.03
    """Root mean square of an error that changes slowly across the image, as a share of the depth."""
    blur_px: Annotated[float, Range(least=0, most=100)] = 1.5
    """Standard deviation of a Gaussian blur of the depth: edges become ramps."""
    noise: Annotated[float, Range(least=0, most=0.3)] = 0.003
    """Standard deviation of independent noise, as a share of the depth."""
    normals: bool = False
    """Write guessed normals too."""
    normal_error_deg: Annotated[float, Range(least=0, most=90)] = 6.0
    """Root mean square of a slowly changing rotation of the normals."""
    normal_blur_px: Annotated[float, Range(least=0, most=100)] = 2.0
    """Standard deviation of a Gaussian blur of the normals."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredDepth:
    """A depth image as stored in 16 bits, with the scale and offset that the reader is not told."""

    values: UInt16[np.ndarray, "h w"]
    """1…65535; 0 = none."""
    scale: float
    """k: z (or 1/z) = k D + b with D = value / 65535, but for the errors."""
    offset: float
    """b."""


def monocular_depth(depth: Depth, config: MonocularDepth, rng: Rng) -> StoredDepth:
    """Simulate the depth that a monocular network predicts.

    z is blurred (holes stay holes), multiplied by 1 + a smooth random field, and by 1 + white noise; then w = z, or
    1/z, is stored as (w - low) / (high - low) in 16 bits. low and high are the image's own least and greatest w, each
    moved outwards by a random share of up to `margin` of their distance. So k = high - low and b = low differ from
    image to image, and no depth can be told from the values.
    """
    field, noise, shares = smooth_field(depth.shape, 1, rng)[..., 0], rng.standard_normal(depth.shape), rng.random(2)
    guess = blurred(depth[..., None], config.blur_px)[..., 0]
    guess = guess * np.maximum(1 + config.waves * field, 0.05) * np.maximum(1 + config.noise * noise, 0.05)
    guess = 1 / guess if config.kind == "inverse" else guess
    known = np.isfinite(guess)
    if not known.any():
        return StoredDepth(values=np.zeros(depth.shape, np.uint16), scale=1.0, offset=0.0)
    low, high = float(guess[known].min()), float(guess[known].max())
    span = max(high - low, 1e-6 * abs(high))
    low, high = low - config.margin * span * shares[0], high + config.margin * span * shares[1]
    shown = np.where(known, (np.where(known, guess, low) - low) / (high - low), 0.0)
    values = np.where(known, np.clip(np.rint(_TOP * shown), 1, _TOP), 0).astype(np.uint16)
    return StoredDepth(values=values, scale=high - low, offset=low)


def monocular_normals(depth: Depth, camera: Camera, config: MonocularDepth, rng: Rng) -> Normals:
    """Simulate predicted normals: those of the depth, turned by a smooth random rotation, then blurred.

    The blur also fills the pixels at rims where the depth gives no normal.
    """
    turn = np.radians(config.normal_error_deg) / np.sqrt(3) * smooth_field(depth.shape, 3, rng)
    exact = fitted_normals(torch.from_numpy(np.ascontiguousarray(depth, np.float32)), camera, 1).double().numpy()
    return unit(blurred(rotated(exact, turn), config.normal_blur_px, fill=True))


def rotated(vectors: Normals, turn: Float[np.ndarray, "h w 3"]) -> Normals:
    """Vectors turned by rotation vectors, radians (Rodrigues)."""
    angle = np.linalg.norm(turn, axis=-1, keepdims=True)
    axis = turn / np.maximum(angle, 1e-12)
    along = (axis * vectors).sum(-1, keepdims=True) * axis
    return along + np.cos(angle) * (vectors - along) + np.sin(angle) * np.cross(axis, vectors)


def unit(vectors: Normals) -> Normals:
    """Directions; what is too short to have one is NaN."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-3, vectors / np.where(length > 1e-3, length, 1.0), np.nan)


def smooth_field(shape: tuple[int, int], channels: int, rng: Rng) -> Float[np.ndarray, "h w c"]:
    """A random field with a few waves across the image, of mean 0 and mean square 1 in each channel."""
    coarse = rng.standard_normal((_WAVES, _WAVES, channels))
    steps = [np.linspace(0, _WAVES - 1, size) for size in shape]
    grid = np.meshgrid(*steps, indexing="ij")
    layers = [scipy.ndimage.map_coordinates(coarse[..., i], grid, order=3, mode="nearest") for i in range(channels)]
    field = np.stack(layers, -1)
    field -= field.mean((0, 1))
    return field / np.maximum(np.sqrt((field**2).mean((0, 1))), 1e-12)


def blurred(values: Float[np.ndarray, "h w c"], sigma_px: float, fill: bool = False) -> Float[np.ndarray, "h w c"]:
    """Gaussian blur of known pixels; the others lend nothing, and stay NaN or are filled from near ones."""
    if sigma_px == 0:
        return values
    known = np.isfinite(values).all(-1, keepdims=True)
    sigma = (sigma_px, sigma_px, 0)
    total = scipy.ndimage.gaussian_filter(np.where(known, values, 0.0), sigma, mode="nearest")
    weight = scipy.ndimage.gaussian_filter(known.astype(float), sigma, mode="nearest")
    return np.where(known | (fill & (weight > 0.02)), total / np.maximum(weight, 1e-12), np.nan)
