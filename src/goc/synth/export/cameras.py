"""Cameras in the conventions of other tools."""

import numpy as np
from jaxtyping import Float64

from goc.scene import Camera

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes: OpenGL looks along -z with y up."""

Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turns a world with z up, as synthetic rooms have it, into one with y up, as ARKit's is."""


def pose_of(camera: Camera) -> Float64[np.ndarray, "4 4"]:
    """Camera to world, OpenCV axes."""
    return camera.world_from_cam.double().cpu().numpy()


def arkit_pose_of(camera: Camera) -> Float64[np.ndarray, "4 4"]:
    """Camera to world, OpenGL axes, in a world with y up."""
    return Y_UP_FROM_Z_UP @ pose_of(camera) @ OPENGL_FROM_OPENCV


def intrinsics_of(camera: Camera) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy, the first pixel centred at 0.5."""
    (fx, fy), (cx, cy) = camera.focal_px.tolist(), camera.centre_px.tolist()
    return fx, fy, cx, cy


def calibration_of(camera: Camera) -> Float64[np.ndarray, "3 3"]:
    """Matrix of intrinsics whose first pixel is centred at 0, as OpenCV, ROS and RGB-D cameras have it."""
    (fx, fy), (cx, cy) = camera.focal_px.tolist(), camera.centre_px.tolist()
    return np.array([[fx, 0.0, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]])


def as_text(matrix: np.ndarray) -> bytes:
    """Rows of numbers with nine digits."""
    return "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in np.atleast_2d(matrix)).encode()
