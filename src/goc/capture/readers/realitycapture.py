"""Reader of RealityCapture's (RealityScan's) registration, "Internal/External camera parameters", .csv.

cameras.csv      #name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2
images/…         or the photographs in any folder below the file
"""

import csv
import io
import math
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from goc.capture.config import CaptureConfig
from goc.capture.lens import Lens
from goc.capture.poses import OPENCV_FROM_OPENGL
from goc.capture.readers.beside import ids_beside, names_beside, photographs
from goc.capture.readers.reader import Reader
from goc.capture.source import Source, View, complain, count_of, shown
from goc.errors import CaptureError, FileError
from goc.events import Listener, Warned
from goc.files import is_file, is_folder, picture_size, read_bytes

_LIMIT = 1 << 28
_FILM_MM = 36.0
_POSE = ("x", "y", "alt", "heading", "pitch", "roll")
_LENS = ("f", "px", "py")
_OPTIONAL = ("k1", "k2", "k3", "k4", "t1", "t2")


def detect(path: Path) -> bool:
    """Whether `path` is such a file, or a folder that holds one."""
    return bool(_listings(path))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read the cameras whose photographs are there.

    Raises:
        FileError: no CSV, or columns or numbers are missing.
        CaptureError: several such files, or photographs are missing.
    """
    files = _listings(path)
    if len(files) > 1:
        names = ", ".join(file.name for file in files[:4])
        raise CaptureError(f"{path}: {len(files)} camera files ({names}). Give the one to read.")
    file = files[0]
    rows = _rows(file)
    images = photographs(file.parent)
    found = {name: image for name in rows if (image := images.get(name) or images.get(Path(name).stem))}
    absent = [name for name in rows if name not in found]
    if absent and (not config.allow_missing or not found):
        remedy = "Put them into images/ beside the file, or pass --capture.allow-missing."
        raise complain(file, absent, len(rows), "photographs are missing", remedy)
    if absent:
        counted = count_of(absent, len(rows))
        message = f"{counted} photographs are missing and left out (first: {shown(absent[0])})"
        notify(Warned(stage="capture", message=message))
    views = tuple(_view(file, rows[name], image) for name, image in found.items())
    return Source(path=file, views=views, id_names=names_beside(file.parent), axes="opengl")


def _listings(path: Path) -> list[Path]:
    files = [path] if is_file(path) else sorted(path.glob("*.csv")) if is_folder(path) else []
    return [file for file in files if file.suffix.lower() == ".csv" and _is_registration(file)]


def _is_registration(file: Path) -> bool:
    try:
        with file.open("rb") as stream:
            head = stream.readline(1000)
    except OSError:
        return False
    return head.lstrip(b"\xef\xbb\xbf").startswith(b"#name") and b"heading" in head


def _rows(file: Path) -> dict[str, dict[str, float]]:
    """Numbers by photograph and column."""
    try:
        text = read_bytes(file, _LIMIT).decode("utf-8-sig")
        table = list(csv.DictReader(io.StringIO(text)))
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{file}: not readable as CSV ({error}). Export it again.") from error
    columns = set(table[0]) if table else set()
    lacking = [name for name in (*_POSE, *_LENS) if name not in columns]
    if lacking:
        raise FileError(f"{file}: has no column {', '.join(lacking)}. Export as Internal/External camera parameters.")
    rows: dict[str, dict[str, float]] = {}
    for number, row in enumerate(table, 2):
        try:
            values = {name: float(row[name]) for name in (*_POSE, *_LENS)}
            values |= {name: float(row.get(name) or 0.0) for name in _OPTIONAL}
        except (TypeError, ValueError) as error:
            raise FileError(f"{file}: line {number} lacks numbers. Export it again.") from error
        if not all(map(math.isfinite, values.values())):
            raise FileError(f"{file}: line {number} holds numbers that are not finite. Export it again.")
        rows[row["#name"]] = values
    return rows


def _view(file: Path, row: dict[str, float], image: Path) -> View:
    width, height = picture_size(image).stored
    side = max(width, height)
    focal = row["f"] * side / _FILM_MM
    centre = (width / 2 + row["px"] * side, height / 2 + row["py"] * side)
    if focal <= 0 or not (0 <= centre[0] <= width and 0 <= centre[1] <= height):
        raise CaptureError(
            f"{file}: {shown(image.name)}: f {row['f']:g}, px {row['px']:g}, py {row['py']:g} make no lens."
        )
    lens = Lens(
        width,
        height,
        (focal, focal),
        centre,
        radial=(row["k1"], row["k2"], row["k3"], row["k4"]),
        tangential=(row["t1"], row["t2"]),
    )
    pose = np.eye(4)
    pose[:3, :3] = _rotation(row["heading"], row["pitch"], row["roll"])
    pose[:3, 3] = row["x"], row["y"], row["alt"]
    return View(
        name=image.relative_to(file.parent).as_posix(),
        lens=lens,
        world_from_cam=pose @ OPENCV_FROM_OPENGL,
        image=image,
        ids=ids_beside(file.parent, Path(image.name)),
    )


def _rotation(heading: float, pitch: float, roll: float) -> Float64[np.ndarray, "3 3"]:
    """world_from_cam of OpenGL axes, from degrees: all 0 looks down with north (+y) up in the image."""
    yaw, tilt, bank = np.radians([-heading, pitch, roll])
    about_z = [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    about_x = [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
    about_y = [[np.cos(bank), 0, np.sin(bank)], [0, 1, 0], [-np.sin(bank), 0, np.cos(bank)]]
    return np.array(about_z) @ np.array(about_x) @ np.array(about_y)


READER = Reader(
    name="RealityCapture", expects=".csv of #name, x, y, alt, heading … (RealityCapture)", detect=detect, read=read
)
