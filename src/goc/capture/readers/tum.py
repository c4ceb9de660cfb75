"""Reader of TUM RGB-D sequences (Sturm et al. 2012), and of others that have its layout: ETH3D SLAM, OpenLORIS.

rgb.txt  depth.txt       lines of time and file; # begins a comment
groundtruth.txt          time tx ty tz qx qy qz qw: camera to world, OpenCV axes
calibration.txt          fx fy cx cy [k1 k2 p1 p2 k3], the first pixel centred at 0

Streams are brought together by time: each image gets the depth nearest in time, and its pose from the two before and
after it. Without calibration.txt, the three cameras of the original data set are known by the folder's name.
"""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation, Slerp

from goc.capture.config import CaptureConfig
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import CENTRE, demand, posed, thinned, warn
from goc.capture.source import Lens, Source, View, count_of, shown
from goc.errors import CaptureError, FileError
from goc.events import Listener
from goc.files import image_size, is_file, read_bytes, read_matrix

_LISTS = ("rgb.txt", "depth.txt", "groundtruth.txt")
_STEPS_PER_METRE = 5000.0
_NEAR_S = 0.02  # between an image and its depth, or a pose
_GAP_S = 0.08  # between two poses that may be interpolated: people turn their hands by degrees in a longer time
_LIMIT = 256 << 20
# fx fy cx cy k1 k2 p1 p2 k3 of the colour cameras, https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
_KNOWN = {
    "1": (517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "2": (520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
    "3": (535.4, 539.2, 320.1, 247.6),
}


def detect(path: Path) -> bool:
    """Whether `path` is a folder with two of the three lists."""
    return sum(is_file(path / name) for name in _LISTS) >= 2


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a sequence.

    Raises:
        FileError: a list is malformed.
        CaptureError: a list is missing, no intrinsics are known, or times have nothing in common.
    """
    demand(path, "TUM RGB-D", [(name, is_file(path / name)) for name in ("rgb.txt", "groundtruth.txt")])
    images = _files(path / "rgb.txt")
    times, poses = _trajectory(path / "groundtruth.txt")
    matched = [_pose_at(time, times, poses) for time, _ in images]
    lost = [name for (_, name), pose in zip(images, matched, strict=True) if pose is None]
    if len(lost) == len(images):
        text = f"{path}: no image has a pose within {_NEAR_S:g} s (first: {shown(lost[0])})"
        raise CaptureError(f"{text}. Check that rgb.txt and groundtruth.txt are of one sequence.")
    if lost:
        counted = count_of(lost, len(images))
        warn(notify, f"{counted} images have no pose at their time and are left out (first: {shown(lost[0])})")
    kept = [(*image, pose) for image, pose in zip(images, matched, strict=True) if pose is not None]
    depth = _files(path / "depth.txt") if is_file(path / "depth.txt") else []
    lens = _lens(path, path / images[0][1])
    views = [
        View(
            name=name,
            lens=lens,
            world_from_cam=pose,
            image=path / name,
            depth=_nearest(path, time, depth),
        )
        for time, name, pose in thinned(kept, config, notify)
    ]
    views = posed(path / "groundtruth.txt", views, notify)
    return Source(path=path, views=views, depth_units_per_metre=_STEPS_PER_METRE, metric=True)


def _lines(path: Path) -> list[list[str]]:
    text = read_bytes(path, _LIMIT).decode("utf-8", "replace")
    lines = (line.split("#")[0].replace(",", " ").split() for line in text.splitlines())
    return [words for words in lines if words]


def _files(path: Path) -> list[tuple[float, str]]:
    """Times and names of a list, in order of time."""
    found = []
    for number, words in enumerate(_lines(path), 1):
        try:
            found.append((float(words[0]), words[1]))
        except (ValueError, IndexError) as error:
            raise FileError(f"{path}: entry {number} is not a time and a file. Write the list again.") from error
    if not found or not np.isfinite([time for time, _ in found]).all():
        raise FileError(f"{path}: lists no files, or times that are not finite. Write the list again.")
    return sorted(found)


def _trajectory(path: Path) -> tuple[Float64[np.ndarray, "p"], Float64[np.ndarray, "p 7"]]:
    try:
        rows = np.array([[float(word) for word in words] for words in _lines(path)], np.float64)
    except ValueError as error:
        raise FileError(f"{path}: expected lines of eight numbers. Write it again.") from error
    if rows.ndim != 2 or rows.shape[1] != 8:
        raise FileError(f"{path}: expected lines of time, position and quaternion (8 numbers). Write it again.")
    rows = rows[np.isfinite(rows).all(1) & (np.linalg.norm(rows[:, 4:], axis=1) > 0.5)]
    times, first = np.unique(rows[:, 0], return_index=True)
    if len(times) == 0:
        raise CaptureError(f"{path}: holds no pose that is finite. The tracking was lost: record it again.")
    return times, rows[first, 1:]


def _pose_at(
    time: float, times: Float64[np.ndarray, "p"], poses: Float64[np.ndarray, "p 7"]
) -> Float64[np.ndarray, "4 4"] | None:
    """Between the poses before and after; the nearest where there is but one; None where none is near."""
    after = int(np.searchsorted(times, time))
    before = max(after - 1, 0)
    after = min(after, len(times) - 1)
    nearest = before if abs(times[before] - time) <= abs(times[after] - time) else after
    between = times[before] < time < times[after] and times[after] - times[before] <= _GAP_S
    if not between and abs(times[nearest] - time) > _NEAR_S:
        return None
    matrix = np.eye(4)
    if not between:
        matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(poses[nearest, 3:]).as_matrix(), poses[nearest, :3]
        return matrix
    share = (time - times[before]) / (times[after] - times[before])
    turns = Slerp([0.0, 1.0], Rotation.from_quat(poses[[before, after], 3:]))
    matrix[:3, :3] = turns(share).as_matrix()
    matrix[:3, 3] = (1 - share) * poses[before, :3] + share * poses[after, :3]
    return matrix


def _nearest(path: Path, time: float, files: list[tuple[float, str]]) -> Path | None:
    """The file nearest in time, where one is near enough."""
    if not files:
        return None
    nearest = min(files, key=lambda entry: abs(entry[0] - time))
    return path / nearest[1] if abs(nearest[0] - time) <= _NEAR_S else None


def _lens(path: Path, image: Path) -> Lens:
    stated = path / "calibration.txt"
    named = re.search(r"(?:freiburg|fr)([123])", path.resolve().name)
    if is_file(stated):
        numbers, (width, height) = tuple(read_matrix(stated).reshape(-1).tolist()), image_size(image)
    elif named:
        numbers, (width, height) = _KNOWN[named[1]], (640, 480)
    else:
        remedy = "Add calibration.txt with fx fy cx cy of the colour images, in pixels, the first centred at 0"
        raise CaptureError(f"{path}: no intrinsics, and the folder's name names none of freiburg1 to 3. {remedy}.")
    if len(numbers) not in (4, 8, 9) or not (numbers[0] > 0 and numbers[1] > 0):
        raise CaptureError(f"{stated}: expected fx fy cx cy, or these and k1 k2 p1 p2 k3. Write it again.")
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = (*numbers, *[0.0] * (9 - len(numbers)))
    return Lens(width, height, (fx, fy), (cx + CENTRE, cy + CENTRE), (k1, k2, k3, 0.0), (p1, p2))


READER = Reader(
    name="TUM RGB-D", expects="rgb.txt, depth.txt and groundtruth.txt (TUM RGB-D)", detect=detect, read=read
)
