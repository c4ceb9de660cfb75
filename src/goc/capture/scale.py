"""How large the world is, where nothing measured it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

_TYPICAL_DISTANCE_M = 2.0
_WORST_CONDITION = 1e-3


def guess_units_per_metre(poses: Sequence[Float64[np.ndarray, "4 4"]]) -> float:
    """Guess how many scene units a metre has, from the camera path alone.

    People photograph what they care about from about two metres: the median distance from the cameras to the point
    nearest to all optical axes counts as 2 m. Where the axes are parallel or that point is behind most cameras, the
    diameter of the camera path counts as 2 m instead. Wrong by a factor of two or three is normal, of ten is not: it
    only gives meaning to thresholds in metres.

    Returns:
        Scene units in one metre; 1 where all cameras stand on one spot.
    """
    positions = np.stack([pose[:3, 3] for pose in poses])
    axes = np.stack([pose[:3, 2] for pose in poses])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # projects onto the plane across each axis
    spread = np.linalg.eigvalsh(across.mean(0))
    diameter = 2 * np.linalg.norm(positions - positions.mean(0), axis=1).max()
    distance = diameter
    if spread[0] > _WORST_CONDITION:
        focus = np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, positions))
        ahead = ((focus - positions) * axes).sum(1) > 0
        if ahead.mean() > 0.5:
            distance = float(np.median(np.linalg.norm(focus - positions, axis=1)))
    return float(distance / _TYPICAL_DISTANCE_M) if distance > 0 else 1.0
