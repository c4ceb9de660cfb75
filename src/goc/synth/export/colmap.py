"""COLMAP: sparse/0 in .bin or .txt, dense depth in stereo/, ids in instance/."""

import struct
from pathlib import Path

import numpy as np
from jaxtyping import Float64, UInt8
from scipy.spatial.transform import Rotation

from goc.files import write_bytes, write_json
from goc.synth.export.exporter import Exporter, Part
from goc.synth.export.room import RoomCapture, RoomView
from goc.synth.sensor.source import link

_PINHOLE = 1
_POINTS = 4000


def _write_binary(room: RoomCapture, out: Path) -> None:
    _write_pixels(room, out)
    sparse = out / "sparse" / "0"
    cameras, images = [], []
    for number, view in enumerate(room.views, 1):
        numbers = (*view.focal_px, *view.centre_px)
        cameras.append(struct.pack("<IiQQ4d", number, _PINHOLE, view.width, view.height, *numbers))
        quaternion, translation = _pose(view)
        name = view.image_path.name.encode() + b"\0"
        images.append(struct.pack("<I7dI", number, *quaternion, *translation, number) + name + struct.pack("<Q", 0))
    points = [
        struct.pack("<Q3d3BdQ", number, *place, *colour, 0.5, 0)
        for number, (place, colour) in enumerate(zip(*_points(room), strict=True), 1)
    ]
    for stem, entries in (("cameras", cameras), ("images", images), ("points3D", points)):
        write_bytes(sparse / f"{stem}.bin", struct.pack("<Q", len(entries)) + b"".join(entries))


def _write_text(room: RoomCapture, out: Path) -> None:
    _write_pixels(room, out)
    write_model(room, out / "sparse" / "0")


def write_model(room: RoomCapture, sparse: Path) -> None:
    """Write cameras, images and points3D in .txt."""
    cameras = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    images = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    for number, view in enumerate(room.views, 1):
        numbers = (*view.focal_px, *view.centre_px)
        cameras.append(f"{number} PINHOLE {view.width} {view.height} {_words(numbers)}")
        quaternion, translation = _pose(view)
        images += [f"{number} {_words(quaternion)} {_words(translation)} {number} {view.image_path.name}", ""]
    points = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]"]
    for number, (place, colour) in enumerate(zip(*_points(room), strict=True), 1):
        points.append(f"{number} {_words(place)} {' '.join(map(str, colour.tolist()))} 0.5")
    for stem, lines in (("cameras", cameras), ("images", images), ("points3D", points)):
        write_bytes(sparse / f"{stem}.txt", ("\n".join(lines) + "\n").encode())


def _write_pixels(room: RoomCapture, out: Path) -> None:
    for view in room.views:
        link(view.image_path, out / "images" / view.image_path.name)
        link(view.ids_path, out / "instance" / f"{view.name}.png")
        depth = np.nan_to_num(view.depth()).astype("<f4")
        header = f"{view.width}&{view.height}&1&".encode()
        write_bytes(out / "stereo" / "depth_maps" / f"{view.image_path.name}.geometric.bin", header + depth.tobytes())
    write_json(out / "labels.json", {str(key): name for key, name in room.names.items()})


def _pose(view: RoomView) -> tuple[Float64[np.ndarray, "4"], Float64[np.ndarray, "3"]]:
    """Quaternion w x y z and translation of cam_from_world."""
    matrix = view.cam_from_world
    return Rotation.from_matrix(matrix[:3, :3]).as_quat(scalar_first=True), matrix[:3, 3]


def _points(room: RoomCapture) -> tuple[Float64[np.ndarray, "p 3"], UInt8[np.ndarray, "p 3"]]:
    """Points that the views' pixels see, spread evenly over views and pixels."""
    places, colours = [], []
    for number, view in enumerate(room.views):
        depth = view.depth().astype(np.float64)
        flat = np.linspace(0, depth.size - 1, -(-_POINTS // len(room.views)) + number % 7).astype(int)
        row, column = np.unravel_index(flat[np.isfinite(depth.reshape(-1)[flat])], depth.shape)
        pixels = np.stack([column + 0.5, row + 0.5], -1)
        rays = np.pad((pixels - view.centre_px) / view.focal_px, ((0, 0), (0, 1)), constant_values=1.0)
        local = rays * depth[row, column][:, None]
        places.append(local @ view.world_from_cam[:3, :3].T + view.world_from_cam[:3, 3])
        colours.append(view.image()[row, column])
    return np.concatenate(places), np.concatenate(colours)


def _words(numbers: object) -> str:
    return " ".join(f"{value:.17g}" for value in np.asarray(numbers, np.float64))


_NO_METRES = frozenset[Part]({"metres"})
BINARY = Exporter(
    name="colmap", writes="sparse/0 in .bin, dense depth, ids in instance/", write=_write_binary, lacks=_NO_METRES
)
TEXT = Exporter(name="colmap-text", writes="the same in .txt", write=_write_text, lacks=_NO_METRES)
