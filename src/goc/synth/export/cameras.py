"""Cameras and pixels in the conventions of other tools, for several exporters."""

import io

import numpy as np
from jaxtyping import Float32, Float64, UInt8, UInt16
from PIL import Image

from goc.scene import ROOM, UNLABELLED
from goc.synth.export.room import RoomCapture, RoomView

Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turns a world with z up, as synthetic rooms have it, into one with y up, as ARKit's is."""
SURE = 2
"""The highest confidence of ARKit's depth."""


def arkit_pose_of(view: RoomView) -> Float64[np.ndarray, "4 4"]:
    """Camera to world, OpenGL axes, in a world with y up."""
    return Y_UP_FROM_Z_UP @ view.opengl_pose


def intrinsics_of(view: RoomView) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy, the first pixel centred at 0.5."""
    return (*view.focal_px, *view.centre_px)


def calibration_of(view: RoomView) -> Float64[np.ndarray, "3 3"]:
    """Matrix of intrinsics whose first pixel is centred at 0, as OpenCV, ROS and RGB-D cameras have it."""
    fx, fy, cx, cy = intrinsics_of(view)
    return np.array([[fx, 0.0, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]])


def as_text(matrix: np.ndarray) -> bytes:
    """Rows of numbers with twelve digits."""
    return "".join(" ".join(f"{value:.12g}" for value in row) + "\n" for row in np.atleast_2d(matrix)).encode()


def steps_of(depth: Float32[np.ndarray, "h w"], steps_per_metre: float) -> UInt16[np.ndarray, "h w"]:
    """Depth in 16 bits; 0 = none, or beyond what they hold."""
    steps = np.rint(np.nan_to_num(depth) * steps_per_metre)
    return np.where(steps <= np.iinfo(np.uint16).max, steps, 0).astype(np.uint16)


def sure_of(depth: Float32[np.ndarray, "h w"], most: int = SURE) -> UInt8[np.ndarray, "h w"]:
    """Confidence of exact depth: the highest where there is any."""
    return np.where(np.isnan(depth), 0, most).astype(np.uint8)


def jpeg_of(view: RoomView) -> bytes:
    """The photograph as JPEG."""
    encoded = io.BytesIO()
    Image.fromarray(view.image()).save(encoded, "JPEG", quality=95, subsampling=0)
    return encoded.getvalue()


def normals_of(view: RoomView) -> Float32[np.ndarray, "h w 3"]:
    """Unit normals towards the camera, camera axes, from differences of depth; NaN where there is none."""
    depth = view.depth().astype(np.float64)
    x = (np.arange(view.width) + 0.5 - view.centre_px[0]) / view.focal_px[0]
    y = (np.arange(view.height) + 0.5 - view.centre_px[1]) / view.focal_px[1]
    rays = np.stack([*np.meshgrid(x, y), np.ones(depth.shape)], -1)
    points = rays * depth[..., None]
    normals = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    normals *= -np.sign((normals * rays).sum(-1, keepdims=True))
    return (normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)).astype(np.float32)


def wall_of(room: RoomCapture) -> int:
    """An id for the room, in formats where walls are an instance like any other: the first that no object has."""
    return 1 + max([0, *room.names, *(int(view.ids().max()) for view in room.views)])


def with_wall(view: RoomView, wall: int) -> UInt16[np.ndarray, "h w"]:
    """Ids with the room's own, and 0 where nothing is labelled."""
    ids = view.ids()
    return np.where(ids == ROOM, wall, np.where(ids == UNLABELLED, 0, ids)).astype(np.uint16)


def names_of(room: RoomCapture) -> dict[int, str]:
    """Names of the objects alone."""
    return {key: name for key, name in room.names.items() if key != ROOM}
