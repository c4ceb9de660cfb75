"""Reader of Metashape's cameras (File → Export → Export Cameras, .xml) beside the photographs.

cameras.xml      any name; sensors of type frame, fisheye or spherical, several of them
images/…         or the photographs in any folder below the file; labels with or without suffix
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float64

from goc.capture.config import CaptureConfig
from goc.capture.lens import Lens, equirectangular
from goc.capture.poses import PoseError, rigid
from goc.capture.readers.beside import ids_beside, names_beside, photographs
from goc.capture.readers.reader import Reader
from goc.capture.source import Source, View, complain, count_of, shown
from goc.errors import CaptureError, FileError
from goc.events import Listener, Warned
from goc.files import is_file, is_folder, read_bytes

_LIMIT = 1 << 28
_HEAD = 4096
_SKEW_PX = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class _Aligned:
    """How a component's own axes become the chunk's, as far as the file says."""

    matrix: Float64[np.ndarray, "4 4"]
    """Rigid: the translation is in the component's unit."""
    scale: float | None


def detect(path: Path) -> bool:
    """Whether `path` is such a file, or a folder that holds one."""
    return bool(_listings(path))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read the cameras that are aligned.

    Raises:
        FileError: no XML, or without what it needs.
        CaptureError: several such files, no camera is aligned, or numbers make no sense.
    """
    files = _listings(path)
    if len(files) > 1:
        names = ", ".join(file.name for file in files[:4])
        raise CaptureError(f"{path}: {len(files)} camera files ({names}). Give the one to read.")
    file = files[0]
    chunk = _chunk(file)
    lenses = {sensor.get("id", ""): _lens(file, sensor) for sensor in chunk.iterfind("./sensors//sensor")}
    frames = {part.get("id", ""): _alignment(file, part.find("transform")) for part in chunk.iterfind(".//component")}
    whole = _alignment(file, chunk.find("transform"))
    views, lost = _views(file, chunk, lenses, frames, whole)
    if not views:
        raise CaptureError(f"{file}: none of {len(lost)} cameras is aligned. Align the photographs in Metashape.")
    if lost:
        message = f"{count_of(lost, len(lost) + len(views))} cameras are not aligned and left out"
        notify(Warned(stage="capture", message=f"{message} (first: {shown(lost[0])})"))
    scales = [frame.scale for frame in (*frames.values(), whole)]
    scaled = any(scale is not None and not math.isclose(scale, 1.0) for scale in scales)
    return Source(path=file, views=views, id_names=names_beside(file.parent), metric=True if scaled else None)


def _listings(path: Path) -> list[Path]:
    files = [path] if is_file(path) else sorted(path.glob("*.xml")) if is_folder(path) else []
    return [file for file in files if file.suffix.lower() == ".xml" and _is_metashape(file)]


def _is_metashape(file: Path) -> bool:
    try:
        with file.open("rb") as stream:
            head = stream.read(_HEAD)
    except OSError:
        return False
    return b"<document" in head and b"<chunk" in head


def _chunk(file: Path) -> ElementTree.Element:
    data = read_bytes(file, _LIMIT)
    if b"<!ENTITY" in data:
        raise FileError(f"{file}: defines entities, which no export of Metashape does. Export it again.")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise FileError(f"{file}: not readable XML ({error}). Export it again.") from error
    chunks = root.findall(".//chunk")
    if len(chunks) != 1:
        raise FileError(f"{file}: holds {len(chunks)} chunks, expected 1. Export one chunk.")
    return chunks[0]


def _numbers(file: Path, element: ElementTree.Element | None, count: int) -> list[float] | None:
    """Numbers in an element's text; None where it is absent."""
    if element is None:
        return None
    try:
        numbers = [float(word) for word in (element.text or "").split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise FileError(f"{file}: <{element.tag}> does not hold {count} numbers. Export it again.")
    return numbers


def _lens(file: Path, sensor: ElementTree.Element) -> Lens | None:
    """The sensor's lens: the adjusted calibration where there are two; None where there is none."""
    resolution = sensor.find("resolution")
    if resolution is None:
        return None
    try:
        width, height = (int(resolution.get(side, "")) for side in ("width", "height"))
    except ValueError as error:
        raise FileError(f"{file}: the resolution of sensor {sensor.get('id')} is no size. Export it again.") from error
    if sensor.get("type") == "spherical":
        return equirectangular(width, height)
    calibrations = sensor.findall("calibration")
    adjusted = [item for item in calibrations if item.get("class") == "adjusted"]
    if not calibrations:
        return None
    return _calibrated(file, sensor, (adjusted or calibrations)[-1], width, height)


def _calibrated(file: Path, sensor: ElementTree.Element, given: ElementTree.Element, width: int, height: int) -> Lens:
    found: dict[str, float] = {}
    for name in ("f", "fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2"):
        numbers = _numbers(file, given.find(name), 1)
        found[name] = numbers[0] if numbers else 0.0
    fy = found["f"] or found["fy"]
    fx = (found["f"] or found["fx"]) + found["b1"]
    centre = (width / 2 + found["cx"], height / 2 + found["cy"])
    if min(fx, fy) <= 0 or not (0 <= centre[0] <= width and 0 <= centre[1] <= height):
        raise CaptureError(f"{file}: sensor {sensor.get('id')}: focal length {fy:g} or principal point make no sense.")
    if abs(found["b2"]) > _SKEW_PX:
        raise CaptureError(
            f"{file}: sensor {sensor.get('id')} has skew (b2 = {found['b2']:g} px). Fix b2 at 0 in Metashape, or export"
            " undistorted photographs."
        )
    radial = (found["k1"], found["k2"], found["k3"], found["k4"])
    kind = "fisheye" if sensor.get("type") == "fisheye" else "perspective"
    # Metashape's p1 stands where OpenCV's p2 does, and the other way round (its manual, appendix C).
    tangential = (found["p2"], found["p1"])
    return Lens(width, height, (fx, fy), centre, radial=radial, tangential=tangential, projection=kind)


def _alignment(file: Path, transform: ElementTree.Element | None) -> _Aligned:
    matrix, scale = np.eye(4), None
    if transform is not None:
        rotation = _numbers(file, transform.find("rotation"), 9)
        translation = _numbers(file, transform.find("translation"), 3)
        factor = _numbers(file, transform.find("scale"), 1)
        scale = factor[0] if factor else None
        if scale is not None and scale <= 0:
            raise FileError(f"{file}: a <scale> is {scale:g}. Export it again.")
        if rotation:
            matrix[:3, :3] = np.reshape(rotation, (3, 3))
        if translation:
            matrix[:3, 3] = translation
    return _Aligned(matrix=matrix, scale=scale)


def _views(
    file: Path,
    chunk: ElementTree.Element,
    lenses: dict[str, Lens | None],
    frames: dict[str, _Aligned],
    whole: _Aligned,
) -> tuple[tuple[View, ...], list[str]]:
    """Views of aligned cameras, and the labels of the others."""
    images = photographs(file.parent)
    views, lost, bad = [], [], []
    cameras: Iterable[ElementTree.Element] = chunk.iterfind("./cameras//camera")
    for camera in cameras:
        label = camera.get("label", "")
        lens = lenses.get(camera.get("sensor_id", ""))
        numbers = _numbers(file, camera.find("transform"), 16)
        if lens is None or numbers is None:
            lost.append(label)
            continue
        try:
            pose = rigid(np.reshape(numbers, (4, 4)))
        except PoseError as error:
            bad.append(f"{shown(label)}: {error}")
            continue
        image = images.get(label) or images.get(Path(label).stem) or file.parent / "images" / label
        views.append(
            View(
                name=image.relative_to(file.parent).as_posix(),
                lens=lens,
                world_from_cam=_moved(pose, frames.get(camera.get("component_id", ""), whole)),
                image=image,
                ids=ids_beside(file.parent, Path(image.name)),
            )
        )
    if bad:
        raise complain(file, bad, len(bad) + len(views), "poses are not usable", "Export the cameras again.")
    return tuple(views), lost


def _moved(pose: Float64[np.ndarray, "4 4"], frame: _Aligned) -> Float64[np.ndarray, "4 4"]:
    """A similarity applied to a pose: positions are scaled, axes are not."""
    scaled = pose.copy()
    scaled[:3, 3] *= frame.scale or 1.0
    return frame.matrix @ scaled


READER = Reader(name="Metashape", expects="cameras .xml (Metashape)", detect=detect, read=read)
