"""Reader of Polycam's raw data ("developer mode").

keyframes/images/TIME.jpg     keyframes/cameras/TIME.json      as recorded
keyframes/corrected_images/…  keyframes/corrected_cameras/…    after Polycam's own alignment, where it ran: preferred
keyframes/depth/TIME.png      16 bits, millimetres             keyframes/confidence/TIME.png  0, 127 or 255

Poses are camera to world with OpenGL axes, row by row (t_00 … t_23); the world is ARKit's, metres, y up.
"""

import math
from pathlib import Path

import msgspec
import numpy as np

from goc.capture.config import CaptureConfig
from goc.capture.poses import OPENCV_FROM_OPENGL
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import COLOUR, demand, numbered, paired, posed, read_all, thinned, warn
from goc.capture.source import Lens, Source, View
from goc.errors import CaptureError
from goc.events import Listener
from goc.files import is_folder, read_json

_BLACK_BORDER = 15 / 1024  # of the width of corrected images, which are resampled
_MEDIUM_CONFIDENCE = 127.0


class _Camera(msgspec.Struct):
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    t_00: float
    t_01: float
    t_02: float
    t_03: float
    t_10: float
    t_11: float
    t_12: float
    t_13: float
    t_20: float
    t_21: float
    t_22: float
    t_23: float


def detect(path: Path) -> bool:
    """Whether `path` is a folder with keyframes/, or keyframes/ itself."""
    return _keyframes(path) is not None


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read raw data.

    Raises:
        FileError: a camera is malformed.
        CaptureError: images or cameras are missing, or a pose is not rigid.
    """
    root = _keyframes(path) or path
    corrected = bool(numbered(root / "corrected_cameras", (".json",)) and numbered(root / "corrected_images", COLOUR))
    prefix = "corrected_" if corrected else ""
    images = numbered(root / f"{prefix}images", COLOUR)
    cameras = numbered(root / f"{prefix}cameras", (".json",))
    demand(path, "Polycam", [("images in keyframes/images/", bool(images)), ("keyframes/cameras/", bool(cameras))])
    if not corrected:
        warn(notify, "no corrected_cameras/: poses are the phone's own, and drift (Polycam's alignment did not run)")
    numbers = thinned(paired(root, images, cameras, "camera", config, notify), config, notify)
    depth, sure = numbered(root / "depth", (".png",)), numbered(root / "confidence", (".png",))
    found = read_all(root, [cameras[number] for number in numbers], lambda file: read_json(file, _Camera), "cameras")
    views = [
        View(
            name=f"{prefix}images/{images[number].name}",
            lens=_lens(cameras[number], camera, corrected),
            world_from_cam=_pose(camera),
            image=images[number],
            depth=depth.get(number),
            confidence=sure.get(number) if number in depth else None,
        )
        for number, camera in zip(numbers, found, strict=True)
    ]
    views = posed(root, views, notify)
    return Source(
        path=path, views=views, least_confidence=_MEDIUM_CONFIDENCE, metric=True, up=(0.0, 1.0, 0.0), axes="opengl"
    )


def _keyframes(path: Path) -> Path | None:
    kinds = ("images", "cameras", "corrected_images", "corrected_cameras")
    for folder in (path / "keyframes", path):
        if sum(is_folder(folder / kind) for kind in kinds) >= (1 if folder is not path else 2):
            return folder
    return None


def _lens(where: Path, camera: _Camera, corrected: bool) -> Lens:
    if not (camera.fx > 0 and camera.fy > 0 and camera.width > 0 and camera.height > 0):
        raise CaptureError(f"{where}: fx, fy, width and height must be positive. Export the capture again.")
    focal, centre = (camera.fx, camera.fy), (camera.cx, camera.cy)
    margin = math.ceil(_BLACK_BORDER * camera.width) if corrected else 0
    return Lens(camera.width, camera.height, focal, centre, margin_px=margin)


def _pose(camera: _Camera) -> np.ndarray:
    rows = [[getattr(camera, f"t_{row}{column}") for column in range(4)] for row in range(3)]
    return np.array([*rows, [0.0, 0.0, 0.0, 1.0]]) @ OPENCV_FROM_OPENGL


READER = Reader(
    name="Polycam", expects="keyframes/ with images and cameras (Polycam raw data)", detect=detect, read=read
)
