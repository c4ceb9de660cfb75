"""The cameras of all tests: one pinhole with any numbers, poses of a few kinds, and captures of what they see.

Poses are world from camera (x right, y down, z forward), float64 (4 4); `pinhole` stores them as goc does, float32.
"""

from collections.abc import Sequence

import numpy as np
import torch

from goc.geometry.rotations import matrices_of_quats
from goc.scene import Camera, Capture, Frame, StoredFrames


def pinhole(focal=60.0, size=(64, 48), centre=None, pose=None) -> Camera:
    """A pinhole camera.

    Args:
        focal: in pixels, one number or one for each of x and y.
        size: width and height.
        centre: principal point in pixels; the middle of the image if None.
        pose: world from camera; at the origin, unturned, if None.
    """
    width, height = size
    middle = (width / 2, height / 2) if centre is None else centre
    return Camera(
        focal_px=torch.as_tensor(focal, dtype=torch.float32).expand(2).clone(),
        centre_px=torch.as_tensor(middle, dtype=torch.float32),
        width=width,
        height=height,
        world_from_cam=torch.as_tensor(np.eye(4) if pose is None else pose, dtype=torch.float32),
    )


def placed(position=(0.0, 0.0, 0.0), yaw=0.0) -> np.ndarray:
    """Looks along z from `position`, turned towards x by `yaw` radians about y."""
    pose = np.eye(4)
    pose[0, 0], pose[0, 2], pose[2, 0], pose[2, 2] = np.cos(yaw), np.sin(yaw), -np.sin(yaw), np.cos(yaw)
    pose[:3, 3] = position
    return pose


def turned(quat, position=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Turned by a quaternion wxyz of any non-zero length."""
    pose = np.eye(4)
    pose[:3, :3] = matrices_of_quats(torch.tensor([quat], dtype=torch.float64))[0]
    pose[:3, 3] = position
    return pose


def looking_at(position, target, up=(0.0, 0.0, 1.0)) -> np.ndarray:
    """At `position` with `target` on the optical axis; `up` is upwards in the image."""
    forward = np.array(target, np.float64) - np.array(position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(forward, right), forward, position], 1)
    return pose


def ring(angles: Sequence[float], radius=2.0, height=0.0, target=(0.0, 0.0, 0.0)) -> list[np.ndarray]:
    """On a circle about the z axis at the given angles (radians), looking at `target`."""
    return [looking_at((radius * np.cos(a), radius * np.sin(a), height), target) for a in angles]


def random_poses(count: int, seed: int, reach=1.0) -> list[np.ndarray]:
    """Turned any way, uniformly over all rotations, within `reach` of the origin along each axis."""
    random = np.random.default_rng(seed)
    return [turned(random.normal(size=4).tolist(), random.uniform(-reach, reach, 3)) for _ in range(count)]


def grey(view: Camera, value=128) -> torch.Tensor:
    """An even photograph of a view's size."""
    return torch.full((view.height, view.width, 3), value, dtype=torch.uint8)


def capture_of(frames: Sequence[Frame], **facts) -> Capture:
    """A capture that holds its frames in memory; `facts` are fields of Capture."""
    held = tuple(frames)
    known = {
        "cameras": tuple(frame.camera for frame in held),
        "view_names": tuple(f"images/{index:03d}.png" for index in range(len(held))),
        "frames": StoredFrames(held),
        "has_depth": any(frame.depth is not None for frame in held),
        "has_ids": any(frame.ids is not None for frame in held),
    }
    return Capture(**{**known, **facts})
