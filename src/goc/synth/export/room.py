"""A room as `goc synth room` wrote it, for exporters: cameras in double precision, images read when asked for."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64, Int16, UInt8

from goc.errors import CaptureError
from goc.files import is_file, read_depth, read_ids, read_image, read_json
from goc.synth.sensor.source import FrameEntry, SourceCapture, read_source

_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class RoomView:
    """One view; pixel (0, 0) is centred at (0.5, 0.5)."""

    name: str
    """Stem of its files, such as 0007."""
    width: int
    height: int
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    world_from_cam: Float64[np.ndarray, "4 4"]
    """Rigid, metres, OpenCV camera axes, z up."""
    image_path: Path
    depth_path: Path
    ids_path: Path

    def image(self) -> UInt8[np.ndarray, "h w 3"]:
        """The photograph, sRGB."""
        return read_image(self.image_path)

    def depth(self) -> Float32[np.ndarray, "h w"]:
        """Exact z along the optical axis, metres, whole millimetres; NaN = none."""
        return read_depth(self.depth_path)

    def ids(self) -> Int16[np.ndarray, "h w"]:
        """Exact ids: 0 = room, 1… = objects."""
        return read_ids(self.ids_path)

    @property
    def cam_from_world(self) -> Float64[np.ndarray, "4 4"]:
        """The inverse of the pose."""
        return np.linalg.inv(self.world_from_cam)

    @property
    def opengl_pose(self) -> Float64[np.ndarray, "4 4"]:
        """world_from_cam with OpenGL camera axes: x right, y up, z back."""
        return self.world_from_cam @ _OPENCV_FROM_OPENGL


@dataclass(frozen=True, kw_only=True, eq=False)
class RoomCapture:
    """A synthetic room's views and names."""

    folder: Path
    views: tuple[RoomView, ...]
    names: dict[int, str]
    """Names of ids, 0 included."""


def read_room(path: Path) -> RoomCapture:
    """Read a folder that `goc synth room` wrote, or one transforms file of it.

    Raises:
        CaptureError: not such a folder: no capture, or depth or ids are missing.
        FileError: a file is malformed.
    """
    source = read_source(path)
    if source.shared.depth_unit_scale_factor != 0.001 or source.shared.depth_kind != "metric":
        raise CaptureError(f"{path}: its depth is not in millimetres. Give a room that goc synth room wrote.")
    frames = {id(entry): entry for entry in source.shared.frames}.values()
    lacking = [entry.file_path for entry in frames if not (entry.depth_file_path and entry.instance_file_path)]
    if lacking:
        raise CaptureError(
            f"{path}: {len(lacking)} of {len(frames)} views have no depth or ids (first: {lacking[0]}). Give a room"
            " that goc synth room wrote."
        )
    labels = source.root / "labels.json"
    names = {int(key): name for key, name in read_json(labels, dict[str, str]).items()} if is_file(labels) else {}
    return RoomCapture(folder=source.root, views=tuple(_view(source, entry) for entry in frames), names=names)


def _view(source: SourceCapture, entry: FrameEntry) -> RoomView:
    source.camera(entry, 2, 2)  # says which number is missing
    given = {name: getattr(entry, name) or getattr(source.shared, name) for name in ("fl_x", "fl_y", "cx", "cy")}
    width, height = (getattr(entry, name) or getattr(source.shared, name) for name in ("w", "h"))
    return RoomView(
        name=Path(entry.file_path).stem,
        width=int(width),
        height=int(height),
        focal_px=(given["fl_x"], given["fl_y"]),
        centre_px=(given["cx"], given["cy"]),
        world_from_cam=np.array(entry.transform_matrix, np.float64) @ _OPENCV_FROM_OPENGL,
        image_path=source.root / entry.file_path,
        depth_path=source.root / str(entry.depth_file_path),
        ids_path=source.root / str(entry.instance_file_path),
    )
