"""sRGB, as files store it, and linear light, as it adds up (IEC 61966-2-1)."""

import numpy as np
from jaxtyping import Float, UInt8


def decode_srgb(encoded: UInt8[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Linear light in [0, 1] of sRGB bytes."""
    values = encoded / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def encode_srgb(linear: Float[np.ndarray, "..."]) -> UInt8[np.ndarray, "..."]:
    """Linear light in [0, 1] as sRGB bytes; values outside are clipped."""
    clipped = np.clip(linear, 0, 1)
    encoded = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return np.round(255 * encoded).astype(np.uint8)
