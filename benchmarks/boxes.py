"""Captures of any size, cheaply: a closed room with boxes on its floor, ray-cast in closed form.

Nothing here is lit or rounded as in `goc synth room`: these captures are for what work costs, not for how good it is.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int16, UInt8

from goc.files import write_depth, write_ids, write_image, write_json

ROOM_M = np.array([6.0, 5.0, 2.6], np.float32)
DISTINCT = 100
"""Views that are ray-cast; further ones are other names for the same files, at the same poses."""


@dataclass(frozen=True, kw_only=True)
class BoxRoom:
    """What to photograph, and how."""

    views: int
    width: int
    height: int
    objects: int


def box_capture(folder: Path, room: BoxRoom) -> Path:
    """Write the capture unless it is there already; returns its folder."""
    if (folder / "transforms.json").is_file():
        return folder
    boxes = _boxes(room.objects)
    focal = 0.75 * room.width
    poses = [_pose(index / min(room.views, DISTINCT)) for index in range(min(room.views, DISTINCT))]
    frames = []
    for index in range(room.views):
        source = index % len(poses)
        if index == source:
            _write(folder, index, _view(boxes, poses[index], focal, room))
        else:
            for name in _names(source):
                os.link(folder / name, folder / _names(index)[_names(source).index(name)])
        image, depth, ids = _names(index)
        frames.append(
            {
                "file_path": image,
                "depth_file_path": depth,
                "instance_file_path": ids,
                "transform_matrix": (poses[source] @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist(),
            }
        )
    lens = {"w": room.width, "h": room.height, "fl_x": focal, "fl_y": focal}
    centre = {"cx": room.width / 2, "cy": room.height / 2, "depth_unit_scale_factor": 0.001}
    write_json(folder / "transforms.json", {"camera_model": "PINHOLE", **lens, **centre, "frames": frames})
    return folder


def _names(index: int) -> tuple[str, str, str]:
    return f"images/{index:04}.png", f"depth/{index:04}.png", f"instance/{index:04}.png"


def _boxes(count: int) -> Float32[np.ndarray, "b 2 3"]:
    """Lower and upper corners, in rows on the floor; from eight of them on, they get smaller as they get more."""
    across = int(np.ceil(np.sqrt(count * 1.2)))
    cell = ROOM_M[:2] * 0.8 / across
    place = np.stack(np.divmod(np.arange(count), across)[::-1], 1)
    low = ROOM_M[:2] * 0.1 + (place + 0.2) * cell
    height = 0.4 + 0.5 * ((np.arange(count) * 7) % 5) / 5
    return np.stack([np.c_[low, np.zeros(count)], np.c_[low + 0.6 * np.minimum(cell, 1.2), height]], 1).astype(
        np.float32
    )


def _pose(turn: float) -> np.ndarray:
    """World from camera, OpenCV axes: three rounds at the walls, each lower, looking across the room."""
    angle = 2 * np.pi * 3 * turn
    middle = ROOM_M.astype(float) / 2
    position = middle + [0.42 * ROOM_M[0] * np.cos(angle), 0.42 * ROOM_M[1] * np.sin(angle), 0.9 - 0.8 * turn]
    forward = np.array([middle[0], middle[1], 0.4]) + 0.6 * np.array([np.sin(angle * 2.3), np.cos(angle), 0]) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(forward, right), forward, position], 1)
    return pose


def _view(
    boxes: Float32[np.ndarray, "b 2 3"], pose: np.ndarray, focal: float, room: BoxRoom
) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], Int16[np.ndarray, "h w"]]:
    """Colour, depth and ids of one view, by slabs."""
    x = (np.arange(room.width, dtype=np.float32) + 0.5 - room.width / 2) / focal
    y = (np.arange(room.height, dtype=np.float32) + 0.5 - room.height / 2) / focal
    flat = np.stack(np.broadcast_arrays(x, y[:, None], np.float32(1)), -1).astype(np.float32)
    rays = flat @ pose[:3, :3].T.astype(np.float32)
    eye = pose[:3, 3].astype(np.float32)
    with np.errstate(divide="ignore"):
        inverse = 1 / rays
    depth = (np.where(rays > 0, ROOM_M - eye, -eye) * inverse).min(-1)
    ids = np.zeros(depth.shape, np.int16)
    for number, (low, high) in enumerate(boxes, 1):
        a, b = (low - eye) * inverse, (high - eye) * inverse
        enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
        nearer = (enter < leave) & (enter > 0) & (enter < depth)
        depth[nearer], ids[nearer] = enter[nearer], number
    points = eye + rays * depth[..., None]
    waves = np.sin(points * np.array([9.0, 11.0, 13.0], np.float32) + ids[..., None] * 2.0)
    grain = np.sin(points.sum(-1) * 60.0)[..., None]
    colour = 128 + 70 * waves * np.array([0.9, 0.7, 0.8], np.float32) + 30 * grain
    return np.rint(colour).clip(0, 255).astype(np.uint8), depth, ids


def _write(folder: Path, index: int, view: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    image, depth, ids = _names(index)
    write_image(folder / image, view[0])
    write_depth(folder / depth, view[1])
    write_ids(folder / ids, view[2])
