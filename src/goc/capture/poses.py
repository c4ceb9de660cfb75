"""Camera poses from text, made exactly rigid or refused."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

_TOLERANCE = 5e-3  # of rotation entries: poses printed with three digits pass, scaled or sheared ones do not
_FARTHEST = 1e8  # positions on the globe; their common offset is taken off before float32

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes: OpenGL looks along -z with y up, OpenCV along z with y down."""


class PoseError(ValueError):
    """Why a matrix is no camera pose, without the file's name."""


def rigid(rows: Sequence[Sequence[float]] | np.ndarray) -> Float64[np.ndarray, "4 4"]:
    """Check that a 4 x 4 (or 3 x 4) matrix is a rigid camera-to-world pose; returns it with an exact rotation.

    The nearest rotation (by singular values) replaces the stored one, so that the transpose is the inverse.

    Raises:
        PoseError: wrong shape, not finite, mirrored, scaled, sheared, or a last row other than 0 0 0 1.
    """
    shapes = {len(row) for row in rows}
    if len(rows) not in (3, 4) or shapes != {4}:
        raise PoseError(f"expected 4 x 4 numbers, found {len(rows)} rows of {sorted(shapes)}")
    matrix = np.asarray(rows, np.float64)
    if not np.isfinite(matrix).all():
        raise PoseError("it holds numbers that are not finite")
    if len(matrix) == 4 and np.abs(matrix[3] - [0, 0, 0, 1]).max() > _TOLERANCE:
        raise PoseError(f"its last row is {' '.join(f'{value + 0:g}' for value in matrix[3])}, not 0 0 0 1")
    if np.abs(matrix[:3, 3]).max() > _FARTHEST:
        raise PoseError(f"it is {np.abs(matrix[:3, 3]).max():.3g} units away")
    rotation = matrix[:3, :3]
    if np.abs(rotation).max() > 2 or np.abs(rotation.T @ rotation - np.eye(3)).max() > _TOLERANCE:
        lengths = " ".join(f"{value:.4g}" for value in np.sqrt((np.minimum(np.abs(rotation), 1e9) ** 2).sum(0)))
        raise PoseError(f"its axes, of lengths {lengths}, are not those of a rotation")
    if np.linalg.det(rotation) < 0:
        raise PoseError("it mirrors (left-handed axes)")
    left, _, right = np.linalg.svd(rotation)
    exact = np.eye(4)
    exact[:3, :3] = left @ right
    exact[:3, 3] = matrix[:3, 3]
    return exact
