"""What worker processes of the tests run: importable by name, since a spawned process starts from nothing."""

import hashlib
import os

from goc.scene import Capture, Frame


def digests(capture: Capture) -> tuple[int, list[str]]:
    """The process that looked, and what it saw: a hash of every view."""
    return os.getpid(), [digest(frame) for frame in capture]


def digest(frame: Frame) -> str:
    """A hash of a view's camera and images."""
    camera = frame.camera
    found = hashlib.sha256(f"{camera.width} x {camera.height}".encode())
    images = (frame.image, frame.depth, frame.normals, frame.ids)
    for part in (camera.focal_px, camera.centre_px, camera.world_from_cam, *images):
        described = "none" if part is None else f"{part.dtype} {tuple(part.shape)}"
        found.update(described.encode())
        found.update(b"" if part is None else part.numpy().tobytes())
    return found.hexdigest()
