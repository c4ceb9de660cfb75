"""Reader of 3D Scanner App's export of all data.

frame_00000.json    cameraPoseARFrame (16 numbers by rows, camera to world, OpenGL axes) and intrinsics (9 by rows)
frame_00000.jpg     of a part of the frames
depth_00000.png     16 bits, millimetres       conf_00000.png    0 to 2

The world is ARKit's: metres, y up.
"""

from pathlib import Path

import msgspec
import numpy as np

from goc.capture.config import CaptureConfig
from goc.capture.poses import OPENCV_FROM_OPENGL
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import COLOUR, demand, numbered, posed, read_all, thinned, warn
from goc.capture.source import Lens, Source, View
from goc.errors import CaptureError
from goc.events import Listener
from goc.files import image_size, read_json

_MEDIUM_CONFIDENCE = 1.0
_STEADY = 0.8  # motionQuality; frames below are blurred


class _Frame(msgspec.Struct):
    cameraPoseARFrame: list[float]  # noqa: N815 - the app's spelling
    intrinsics: list[float]
    motionQuality: float = 1.0  # noqa: N815


def detect(path: Path) -> bool:
    """Whether `path` is a folder with frame_N.json or, to be told what is missing, with frame_N.jpg and depth_N.png."""
    if numbered(path, (".json",), r"frame_(\d+)"):
        return True
    return bool(numbered(path, COLOUR, r"frame_(\d+)") and numbered(path, (".png",), r"depth_(\d+)"))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read an export: the frames that have a photograph and were held steady.

    Raises:
        FileError: a frame's JSON is malformed.
        CaptureError: photographs or poses are missing, or a pose is not rigid.
    """
    images = numbered(path, COLOUR, r"frame_(\d+)")
    stated = numbered(path, (".json",), r"frame_(\d+)")
    both = [number for number in stated if number in images]
    needed = [("frame_*.json", bool(stated)), ("frame_*.jpg", bool(images)), ("a frame_*.jpg of a json", bool(both))]
    demand(path, "3D Scanner App", needed)
    frames = read_all(path, [stated[number] for number in both], lambda file: read_json(file, _Frame), "frames")
    steady = [item for item in zip(both, frames, strict=True) if item[1].motionQuality >= _STEADY]
    if 2 * len(steady) < len(both):
        steady = list(zip(both, frames, strict=True))
    elif len(steady) < len(both):
        warn(notify, f"{len(both) - len(steady)} of {len(both)} frames moved too fast (motionQuality) and are left out")
    depth, sure = (numbered(path, (".png",), rf"{kind}_(\d+)") for kind in ("depth", "conf"))
    views = [
        View(
            name=images[number].name,
            lens=_lens(stated[number], frame, images[number]),
            world_from_cam=_pose(stated[number], frame) @ OPENCV_FROM_OPENGL,
            image=images[number],
            depth=depth.get(number),
            confidence=sure.get(number) if number in depth else None,
        )
        for number, frame in thinned(steady, config, notify)
    ]
    views = posed(path, views, notify)
    return Source(
        path=path, views=views, least_confidence=_MEDIUM_CONFIDENCE, metric=True, up=(0.0, 1.0, 0.0), axes="opengl"
    )


def _pose(where: Path, frame: _Frame) -> np.ndarray:
    if len(frame.cameraPoseARFrame) != 16:
        raise CaptureError(f"{where}: cameraPoseARFrame has not 16 numbers. Export the scan again.")
    return np.array(frame.cameraPoseARFrame, np.float64).reshape(4, 4)


def _lens(where: Path, frame: _Frame, image: Path) -> Lens:
    numbers = frame.intrinsics
    if len(numbers) != 9 or not (numbers[0] > 0 and numbers[4] > 0):
        raise CaptureError(f"{where}: intrinsics are no 3 x 3 matrix with focal lengths. Export the scan again.")
    width, height = image_size(image)
    return Lens(width, height, (numbers[0], numbers[4]), (numbers[2], numbers[5]))


READER = Reader(
    name="3D Scanner App", expects="frame_00000.json and .jpg (3D Scanner App, all data)", detect=detect, read=read
)
