"""Reader of Stray Scanner's recordings.

rgb.mp4              its frames are taken out once, into a cache folder; or rgb/000000.jpg, where somebody did so before
camera_matrix.csv    3 x 3, of the video's pixels
odometry.csv         timestamp, frame, x, y, z, qx, qy, qz, qw: camera to world, OpenCV axes; newer: fx, fy, cx, cy too
depth/000000.png     16 bits, millimetres; or .npy       confidence/000000.png    0 to 2

The world is ARKit's: metres, y up.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from goc.capture.config import CaptureConfig
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import COLOUR, demand, numbered, posed, step_of, warn
from goc.capture.source import Lens, Source, View, count_of
from goc.capture.video import video_frames
from goc.errors import CaptureError, FileError
from goc.events import Listener
from goc.files import image_size, is_file, read_bytes, read_matrix

_MEDIUM_CONFIDENCE = 1.0
_LIMIT = 256 << 20
_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_LENS = ("fx", "fy", "cx", "cy")


@dataclass(frozen=True)
class _Row:
    """Pose of a frame, and its own intrinsics where the app wrote them."""

    pose: Float64[np.ndarray, "4 4"]
    intrinsics: tuple[float, ...] | None


def detect(path: Path) -> bool:
    """Whether `path` is a folder with odometry.csv, or camera_matrix.csv and rgb.mp4."""
    return is_file(path / "odometry.csv") or (is_file(path / "camera_matrix.csv") and is_file(path / "rgb.mp4"))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a recording.

    Raises:
        FileError: a file is malformed, or nothing here can decode videos.
        CaptureError: a part is missing, or a pose is not rigid.
    """
    video, stills = path / "rgb.mp4", numbered(path / "rgb", COLOUR)
    files = ("odometry.csv", "camera_matrix.csv")
    needed = [*((name, is_file(path / name)) for name in files), ("rgb.mp4", is_file(video) or bool(stills))]
    demand(path, "Stray Scanner", needed)
    rows = _odometry(path / "odometry.csv")
    step = step_of(len(rows), config, notify)
    images = stills or video_frames(video, step, notify)
    wanted = [number for number in rows if number % step == 0]
    numbers = [number for number in wanted if number in images]
    if not numbers:
        raise CaptureError(f"{path}: the frames of odometry.csv are not those of the video. Export the scan again.")
    if len(numbers) < len(wanted):
        counted = count_of(range(len(wanted) - len(numbers)), len(wanted))
        warn(notify, f"{counted} poses have no frame in the video and are not used")
    lens = _lens(path / "camera_matrix.csv", image_size(images[numbers[0]]))
    depth, sure = numbered(path / "depth", (".png", ".npy")), numbered(path / "confidence", (".png",))
    views = [
        View(
            name=f"rgb/{number:06}",
            lens=_own(lens, rows[number]),
            world_from_cam=rows[number].pose,
            image=images[number],
            depth=depth.get(number),
            confidence=sure.get(number) if number in depth else None,
        )
        for number in numbers
    ]
    views = posed(path / "odometry.csv", views, notify)
    return Source(path=path, views=views, least_confidence=_MEDIUM_CONFIDENCE, metric=True, up=(0.0, 1.0, 0.0))


def _odometry(path: Path) -> dict[int, _Row]:
    """Rows by the number of their frame."""
    lines = read_bytes(path, _LIMIT).decode("utf-8", "replace").splitlines()
    table = csv.reader(lines, skipinitialspace=True)
    header = [name.strip() for name in next(table, [])]
    if not {"frame", *_POSE} <= set(header):
        raise CaptureError(f"{path}: lacks the columns frame, {', '.join(_POSE)}. Export the scan again.")
    found: dict[int, _Row] = {}
    for number, cells in enumerate(table, 1):
        row = dict(zip(header, cells, strict=False))
        try:
            pose = _pose([float(row[name]) for name in _POSE])
            own = tuple(float(row[name]) for name in _LENS) if set(_LENS) <= set(row) else None
            found[int(row["frame"])] = _Row(pose, own)
        except (KeyError, ValueError) as error:
            raise FileError(f"{path}: line {number + 1} is not of numbers. Export the scan again.") from error
    if not found:
        raise CaptureError(f"{path}: holds no poses. Export the scan again.")
    return dict(sorted(found.items()))


def _pose(numbers: list[float]) -> Float64[np.ndarray, "4 4"]:
    matrix = np.full((4, 4), np.nan)
    if np.isfinite(numbers).all() and np.linalg.norm(numbers[3:]) > 0.5:
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(numbers[3:]).as_matrix()
        matrix[:3, 3] = numbers[:3]
    return matrix


def _lens(where: Path, size: tuple[int, int]) -> Lens:
    matrix = read_matrix(where)
    if matrix.shape != (3, 3) or not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise CaptureError(f"{where}: expected a 3 x 3 matrix with focal lengths. Export the scan again.")
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Lens(*size, (fx, fy), (cx, cy))


def _own(lens: Lens, row: _Row) -> Lens:
    if row.intrinsics is None or not (row.intrinsics[0] > 0 and row.intrinsics[1] > 0):
        return lens
    fx, fy, cx, cy = row.intrinsics
    return Lens(lens.width, lens.height, (fx, fy), (cx, cy))


READER = Reader(
    name="Stray Scanner", expects="rgb.mp4, odometry.csv and depth/ (Stray Scanner)", detect=detect, read=read
)
