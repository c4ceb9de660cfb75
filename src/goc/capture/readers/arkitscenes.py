"""Reader of ARKitScenes (Baruch et al. 2021), as downloaded for 3D object detection or raw.

lowres_wide/ID_TIME.png  lowres_depth/ID_TIME.png (millimetres)  confidence/ID_TIME.png (0 to 2)
lowres_wide_intrinsics/ID_TIME.pincam     width height fx fy cx cy; times may differ by a millisecond
lowres_wide.traj                          time, axis-angle, translation: world to camera, OpenCV axes

The world is metric with z up.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from goc.capture.config import CaptureConfig
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import demand, posed, read_all, thinned, warn
from goc.capture.source import Lens, Source, View, complain, count_of, shown
from goc.errors import CaptureError
from goc.events import Listener
from goc.files import is_file, is_folder, read_matrix

_NEAR_S = 0.005
_TRAJECTORY_LIMIT = 256 << 20
_MEDIUM_CONFIDENCE = 1.0
_IMAGES, _POSES = "lowres_wide", "lowres_wide.traj"


def detect(path: Path) -> bool:
    """Whether `path` is a folder with lowres_wide/ or lowres_wide.traj, or has one folder that is."""
    return _frames(path) is not None


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a scan.

    Raises:
        FileError: a file is malformed.
        CaptureError: a part is missing, or times have nothing in common.
    """
    root = _frames(path) or path
    images, cameras = _timed(root / _IMAGES, ".png"), _timed(root / f"{_IMAGES}_intrinsics", ".pincam")
    needed = [(f"images in {_IMAGES}/", bool(images)), (f"{_IMAGES}_intrinsics/", bool(cameras))]
    demand(path, "ARKitScenes", [*needed, (_POSES, is_file(root / _POSES))])
    times, poses = _trajectory(root / _POSES)
    found = [(time, file, _near(times, time), _near_file(cameras, time)) for time, file in images]
    kept = [(time, file, row, camera) for time, file, row, camera in found if row is not None and camera is not None]
    if not kept:
        raise complain(root, [images[0][1].name], len(images), "images have no pose", "Download the scan again.")
    if len(kept) < len(images):
        first = next(file for _, file, row, camera in found if row is None or camera is None)
        counted = count_of(range(len(images) - len(kept)), len(images))
        warn(notify, f"{counted} images have no pose at their time and are left out (first: {shown(first.name)})")
    kept = thinned(kept, config, notify)
    lenses = read_all(root, [camera for *_, camera in kept], _lens, "intrinsics")
    depth, sure = _timed(root / "lowres_depth", ".png"), _timed(root / "confidence", ".png")
    views = []
    for (time, file, row, _), lens in zip(kept, lenses, strict=True):
        measured = _near_file(depth, time)
        views.append(
            View(
                name=f"{_IMAGES}/{file.name}",
                lens=lens,
                world_from_cam=poses[row],
                image=file,
                depth=measured,
                confidence=_near_file(sure, time) if measured else None,
            )
        )
    views = posed(root / _POSES, views, notify)
    return Source(
        path=path,
        views=views,
        least_confidence=_MEDIUM_CONFIDENCE,
        metric=True,
        up=(0.0, 0.0, 1.0),
        direction="world-to-camera",
    )


def _frames(path: Path) -> Path | None:
    if not is_folder(path):
        return None
    inner = [folder for folder in sorted(path.glob("*_frames")) if is_folder(folder)]
    for folder in (path, *inner[: len(inner) == 1]):
        if is_folder(folder / _IMAGES) or is_file(folder / _POSES):
            return folder
    return None


def _timed(folder: Path, suffix: str) -> list[tuple[float, Path]]:
    """Files by the time in their names, ID_TIME."""
    found = []
    for file in folder.glob(f"*{suffix}") if is_folder(folder) else ():
        try:
            found.append((float(file.stem.rpartition("_")[2]), file))
        except ValueError:
            continue  # not one of the stream's
    return sorted(found)


def _trajectory(path: Path) -> tuple[Float64[np.ndarray, "p"], Float64[np.ndarray, "p 4 4"]]:
    """Times and camera-to-world poses."""
    rows = read_matrix(path, finite=False, limit=_TRAJECTORY_LIMIT)
    if rows.shape[1] != 7:
        raise CaptureError(f"{path}: {rows.shape[1]} numbers a line, not the 7 of a pose. Download it again.")
    rows = rows[np.argsort(rows[:, 0])]
    poses = np.full((len(rows), 4, 4), np.nan)
    known = np.isfinite(rows).all(1)
    turns = Rotation.from_rotvec(rows[known, 1:4]).as_matrix()
    poses[known] = np.eye(4)
    poses[known, :3, :3] = turns.transpose(0, 2, 1)
    poses[known, :3, 3] = -np.einsum("nji,nj->ni", turns, rows[known, 4:])
    return rows[:, 0], poses


def _near(times: Float64[np.ndarray, "p"], time: float) -> int | None:
    at = int(np.searchsorted(times, time))
    beside = [place for place in (at - 1, at) if 0 <= place < len(times)]
    best = min(beside, key=lambda place: abs(times[place] - time), default=None)
    return best if best is not None and abs(times[best] - time) <= _NEAR_S else None


def _near_file(files: list[tuple[float, Path]], time: float) -> Path | None:
    place = _near(np.array([at for at, _ in files]), time)
    return None if place is None else files[place][1]


def _lens(file: Path) -> Lens:
    numbers = read_matrix(file).reshape(-1).tolist()
    if len(numbers) != 6 or not all(number > 0 for number in numbers[:4]):
        raise CaptureError(f"{file}: expected width height fx fy cx cy. Download it again.")
    width, height, fx, fy, cx, cy = numbers
    return Lens(int(width), int(height), (fx, fy), (cx, cy))


READER = Reader(name="ARKitScenes", expects="lowres_wide/ and lowres_wide.traj (ARKitScenes)", detect=detect, read=read)
