"""What the user knows better than the format: what poses and depth mean, put right before anything is checked."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float64

from goc.capture.source import CameraAxes, PoseDirection, Source
from goc.settings import Positive, Range, Settings

StoredId = Annotated[int, Range(least=0, most=65535)]

OPENCV_AXES: dict[CameraAxes, Float64[np.ndarray, "3 3"]] = {
    "opencv": np.eye(3),
    "opengl": np.diag([1.0, -1.0, -1.0]),
    "ros": np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}
"""By name: columns are right, down and forward in the camera's own axes (named_from_opencv)."""


@dataclass(frozen=True, kw_only=True)
class Convention(Settings):
    """How stored numbers are meant, where the files say otherwise or nothing. Checks tell what they look like."""

    poses: PoseDirection | None = None
    """What the stored poses map from and to. Default: as the format has it."""
    axes: CameraAxes | None = None
    """Camera axes of the stored poses. opencv: x right, y down, z forward. opengl: x right, y up, z back. ros: x
    forward, y left, z up. Default: as the format has it."""
    pose_unit: Positive | None = None
    """Scene units (metres, where depth is metric) in one unit of the stored positions and points, such as 0.001."""
    depth_unit: Positive | None = None
    """Scene units in one step of the stored depth: 0.001 for millimetres. Default: as the capture says."""
    room_ids: tuple[StoredId, ...] = ()
    """Stored ids of walls, floor and ceiling, where these are instances of their own, as ScanNet has them. What is
    stored as 0 then counts as unlabelled, since nobody annotated it."""


def restated(source: Source, convention: Convention) -> Source:
    """The capture as the user says that its numbers are meant."""
    scale = convention.pose_unit or 1.0
    steps = None if convention.depth_unit is None else 1.0 / convention.depth_unit
    views = tuple(
        replace(
            view,
            world_from_cam=_scaled(reread(view.world_from_cam, source, convention), scale),
            depth_units_per_metre=steps or view.depth_units_per_metre,
        )
        for view in source.views
    )
    points = source.points
    if points is not None:
        positions = points.positions * np.asarray(scale, points.positions.dtype)
        points = replace(points, positions=positions)
    codes = replace(source.id_codes, room=convention.room_ids or source.id_codes.room)
    units = steps or source.depth_units_per_metre
    return replace(source, views=views, points=points, depth_units_per_metre=units, id_codes=codes)


def reread(
    pose: Float64[np.ndarray, "*b 4 4"], source: Source, convention: Convention
) -> Float64[np.ndarray, "*b 4 4"]:
    """A pose (world from camera, OpenCV axes) as its numbers read under another convention.

    Args:
        pose: as the reader understood it, by the format's own convention, which `source` tells.
        source: of the pose.
        convention: what it says of poses and axes wins.
    """
    stored = pose @ _padded(OPENCV_AXES[source.axes].T)
    direction = convention.poses or source.direction
    if direction != source.direction:
        stored = inverse(stored)
    return stored @ _padded(OPENCV_AXES[convention.axes or source.axes])


def inverse(pose: Float64[np.ndarray, "*b 4 4"]) -> Float64[np.ndarray, "*b 4 4"]:
    """Inverse of a rigid pose."""
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    made = np.zeros_like(pose)
    made[..., :3, :3] = turned
    made[..., :3, 3] = -np.einsum("...ij,...j->...i", turned, pose[..., :3, 3])
    made[..., 3, 3] = 1.0
    return made


def _padded(rotation: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "4 4"]:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return matrix


def _scaled(pose: Float64[np.ndarray, "4 4"], scale: float) -> Float64[np.ndarray, "4 4"]:
    scaled = pose.copy()
    scaled[:3, 3] *= scale
    return scaled
