"""nerfstudio's transforms.json with intrinsics in each frame, photographed by a pinhole or by a fisheye."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Shaped, UInt8
from scipy.ndimage import map_coordinates

from goc.files import write_depth, write_ids, write_image, write_json
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture, RoomView
from goc.synth.sensor.source import link


def _write(room: RoomCapture, out: Path) -> None:
    """Intrinsics in each frame, the shared depth unit at the top."""
    frames = []
    for view in room.views:
        link(view.image_path, out / "images" / view.image_path.name)
        link(view.depth_path, out / "depth" / f"{view.name}.png")
        link(view.ids_path, out / "instance" / f"{view.name}.png")
        frames.append(_frame(view, view.image_path.name) | _numbers(view))
    _write_documents(room, out, {"camera_model": "OPENCV"}, frames)


def _write_fisheye(room: RoomCapture, out: Path) -> None:
    """An equidistant fisheye whose circle lies within what the room's pinhole camera saw."""
    frames = []
    for view in room.views:
        at = _pinhole_pixels(view)
        write_image(out / "images" / f"{view.name}.png", _mixed(view.image(), at))
        write_depth(out / "depth" / f"{view.name}.png", _picked(view.depth(), at, np.nan))
        write_ids(out / "instance" / f"{view.name}.png", _picked(view.ids(), at, -1.0))
        circle = {"fisheye_crop_radius": _circle_px(view)}
        frames.append(_frame(view, f"{view.name}.png") | _numbers(view) | circle)
    _write_documents(room, out, {"camera_model": "OPENCV_FISHEYE", "k1": 0.0}, frames)


def _write_documents(room: RoomCapture, out: Path, shared: dict[str, Any], frames: list[dict[str, Any]]) -> None:
    write_json(out / "labels.json", {str(key): name for key, name in room.names.items()})
    write_json(out / "transforms.json", shared | {"depth_unit_scale_factor": 0.001, "frames": frames})


def _frame(view: RoomView, image: str) -> dict[str, Any]:
    return {
        "file_path": f"images/{image}",
        "depth_file_path": f"depth/{view.name}.png",
        "transform_matrix": view.opengl_pose.tolist(),
    }


def _numbers(view: RoomView) -> dict[str, float]:
    (fl_x, fl_y), (cx, cy) = view.focal_px, view.centre_px
    return {"fl_x": fl_x, "fl_y": fl_y, "cx": cx, "cy": cy, "w": view.width, "h": view.height}


def _circle_px(view: RoomView) -> float:
    """The largest circle that both images hold: what is farther from the axis was not photographed."""
    x, y = view.centre_px
    reach = min(x, view.width - x, y, view.height - y)
    return float(min(reach, np.arctan(reach / max(view.focal_px)) * min(view.focal_px)))


def _pinhole_pixels(view: RoomView) -> Float64[np.ndarray, "h w 2"]:
    """Where each pixel of the fisheye image is in the pinhole image; the fisheye has the same focal lengths."""
    u, v = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    plane = (np.stack([u, v], -1) - view.centre_px) / view.focal_px
    angle = np.linalg.norm(plane, axis=-1, keepdims=True)
    stretch = np.where(angle > 0, np.tan(np.minimum(angle, 1.5)) / np.maximum(angle, 1e-12), 1.0)
    return plane * stretch * view.focal_px + view.centre_px


def _picked(
    image: Shaped[np.ndarray, "h w ..."], at: Float64[np.ndarray, "h w 2"], otherwise: float
) -> Shaped[np.ndarray, "h w ..."]:
    """The pixels at some places; `otherwise` outside the image."""
    height, width = image.shape[:2]
    column, row = np.floor(at).astype(int).transpose(2, 0, 1)
    outside = (column < 0) | (column >= width) | (row < 0) | (row >= height)
    picked = image[row.clip(0, height - 1), column.clip(0, width - 1)].copy()
    picked[outside] = otherwise
    return picked


def _mixed(image: UInt8[np.ndarray, "h w 3"], at: Float64[np.ndarray, "h w 2"]) -> UInt8[np.ndarray, "h w 3"]:
    """Colours at some places, bilinear between pixels; those of the border outside."""
    places = np.moveaxis(at[..., ::-1] - 0.5, -1, 0)
    planes = [
        map_coordinates(image[..., channel].astype(float), places, order=1, mode="nearest") for channel in range(3)
    ]
    return np.rint(np.stack([*planes], -1)).astype(np.uint8)


EXPORTER = Exporter(name="nerfstudio", writes="transforms.json, depth, ids in instance/", write=_write)
FISHEYE = Exporter(
    name="nerfstudio-fisheye",
    writes="the same, photographed by an equidistant fisheye",
    write=_write_fisheye,
    resampled=True,
)
