"""Reader of 7-Scenes (Shotton et al. 2013), and of 3DMatch's scenes and others that have its layout.

frame-000000.color.png  frame-000000.depth.png  frame-000000.pose.txt      in the folder, or in its seq-01, seq-02, …
camera-intrinsics.txt    3 x 3, of colour and depth alike, where they are registered (3DMatch); not in 7-Scenes

Poses are camera to world, OpenCV axes; depth is in millimetres, 65535 = none. 7-Scenes gives pictures and depth of a
Kinect as its two cameras saw them, with the depth camera's poses: depth is seen again from where colour was.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64

from goc.capture.config import CaptureConfig
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import CENTRE, COLOUR, demand, numbered, posed, read_all, thinned
from goc.capture.source import Lens, Source, View
from goc.errors import CaptureError
from goc.events import Listener
from goc.files import image_size, is_file, is_folder, raster_size, read_matrix, read_raster

_SIZE = (640, 480)
_DEPTH_FOCAL, _COLOUR_FOCAL = 585.0, 525.0  # of the data set's page, and of Kinects as they leave the factory
_BASELINE = np.array([-0.025, 0.0, 0.0])  # colour is 25 mm to the right of depth: where its points lie in colour's axes
_NONE = 65535


@dataclass(frozen=True)
class _Shot:
    """Files of a view."""

    image: Path
    depth: Path | None
    pose: Path


def detect(path: Path) -> bool:
    """Whether `path` holds frame-N.color.png or frame-N.pose.txt, or has folders seq-N that do."""
    return any(_numbered(folder, "color", COLOUR) or _numbered(folder, "pose", (".txt",)) for folder in _folders(path))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a sequence, or all those of a scene.

    Raises:
        FileError: a pose or the intrinsics are malformed.
        CaptureError: images or poses are missing, or a pose is not rigid.
    """
    shots = thinned(_shots(path), config, notify)
    poses = read_all(path, [shot.pose for shot in shots], partial(read_matrix, finite=False), "poses")
    stated = next((file for folder in (path, path.parent) if is_file(file := folder / "camera-intrinsics.txt")), None)
    matrix = None if stated is None else _intrinsics(stated)
    of_depth = matrix is not None and abs(matrix[0, 0] - _DEPTH_FOCAL) < 1.0  # written for depth, and for it alone
    registered = matrix is not None and not of_depth
    from_colour = np.eye(4)
    from_colour[:3, 3] = 0.0 if registered else -_BASELINE
    views = [
        View(
            name=str(shot.image.relative_to(path)),
            lens=_lens(shot.image, matrix) if registered and matrix is not None else _kinect(_COLOUR_FOCAL),
            world_from_cam=_shaped(shot.pose, pose) @ from_colour,
            image=shot.image,
            depth=shot.depth if registered or shot.depth is None else SeenFromColour(shot.depth),
        )
        for shot, pose in zip(shots, poses, strict=True)
    ]
    return Source(path=path, views=posed(path, views, notify), metric=True)


@dataclass(frozen=True)
class SeenFromColour:
    """Depth of a Kinect's depth camera, as its colour camera would have measured it."""

    path: Path

    def size(self) -> tuple[int, int]:
        """Width and height."""
        return raster_size(self.path)

    def read(self) -> Float32[np.ndarray, "h w"]:
        """Millimetres, 0 = none; of two points in a pixel the nearer one. Raises FileError."""
        stored = read_raster(self.path)
        height, width = stored.shape
        own, other = (_kinect(focal).resized(width, height) for focal in (_DEPTH_FOCAL, _COLOUR_FOCAL))
        rows, columns = np.nonzero((stored > 0) & (stored < _NONE))
        z = stored[rows, columns].astype(np.float64)
        x = (columns + CENTRE - own.centre_px[0]) / own.focal_px[0] * z + _BASELINE[0] * 1000
        y = (rows + CENTRE - own.centre_px[1]) / own.focal_px[1] * z + _BASELINE[1] * 1000
        column = np.floor(x / z * other.focal_px[0] + other.centre_px[0]).astype(int)
        row = np.floor(y / z * other.focal_px[1] + other.centre_px[1]).astype(int)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        seen = np.full(height * width, np.inf)
        np.minimum.at(seen, row[inside] * width + column[inside], z[inside])
        return np.where(np.isfinite(seen), seen, 0).astype(np.float32).reshape(height, width)


def _folders(path: Path) -> list[Path]:
    return [path, *sorted(folder for folder in path.glob("seq-*") if is_folder(folder))] if is_folder(path) else []


def _numbered(folder: Path, kind: str, suffixes: tuple[str, ...]) -> dict[int, Path]:
    return numbered(folder, suffixes, rf"frame-(\d+)\.{kind}")


def _shots(path: Path) -> list[_Shot]:
    shots: list[_Shot] = []
    for folder in _folders(path):
        images, poses = _numbered(folder, "color", COLOUR), _numbered(folder, "pose", (".txt",))
        depth = _numbered(folder, "depth", (".png",))
        if images or poses:
            first = next((number for number in images if number not in poses), None)
            needed = [("frame-*.color.png", bool(images)), (f"frame-{first or 0:06}.pose.txt", first is None)]
            demand(folder, "7-Scenes", needed)
            shots += [_Shot(image, depth.get(number), poses[number]) for number, image in images.items()]
    return shots


def _kinect(focal: float) -> Lens:
    width, height = _SIZE
    return Lens(width, height, (focal, focal), (width / 2 + CENTRE, height / 2 + CENTRE))


def _intrinsics(path: Path) -> Float64[np.ndarray, "3 3"]:
    matrix = read_matrix(path)
    if matrix.shape != (3, 3) or not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise CaptureError(f"{path}: expected a 3 x 3 matrix of intrinsics. Download it again.")
    return matrix


def _lens(image: Path, matrix: Float64[np.ndarray, "3 3"]) -> Lens:
    width, height = image_size(image)
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Lens(width, height, (fx, fy), (cx + CENTRE, cy + CENTRE))


def _shaped(path: Path, pose: Float64[np.ndarray, "rows columns"]) -> Float64[np.ndarray, "4 4"]:
    if pose.shape != (4, 4):
        raise CaptureError(f"{path}: expected 4 x 4 numbers, found {' x '.join(map(str, pose.shape))}. Copy it again.")
    return pose


READER = Reader(
    name="7-Scenes", expects="frame-000000.color.png, .depth.png and .pose.txt (7-Scenes)", detect=detect, read=read
)
