"""The demo capture: a furnished room, photographed on the fly, written as a nerfstudio folder with ground truth."""

import io
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from goc.errors import ConfigError
from goc.events import Listener, Progress, ignore
from goc.files.atomic import write_bytes
from goc.files.documents import write_json
from goc.files.images import write_depth, write_ids, write_png
from goc.files.meshes import write_mesh
from goc.scene import Camera
from goc.synth.cameras import camera_path
from goc.synth.folders import check_new
from goc.synth.lighting import bake
from goc.synth.model import mesh_of
from goc.synth.render import View, render_view
from goc.synth.room import Room, furnish_room
from goc.synth.surfaces import gather_surfaces
from goc.synth.truth import true_samples

_STAGE = "synth"
# y and z of camera axes change their signs between OpenCV (goc) and OpenGL (nerfstudio).
_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class RoomConfig:
    """A capture of a procedural room. The same settings give the same bytes."""

    seed: int = 0
    """Chooses the room, its things, and the way through it."""
    views: int = 60
    """Number of photographs, at least 8."""
    width: int = 320
    """Width of the photographs, pixels."""
    height: int = 240
    """Height of the photographs, pixels."""
    objects: int = 12
    """Number of things in the room, 6 to 16; large numbers do not fit every room."""
    samples: int = 4
    """Light rays a pixel: more make shadows smoother and rendering slower."""

    def __post_init__(self) -> None:
        limits = {
            "seed": (0, 2**31),
            "views": (8, 100_000),
            "width": (16, 8192),
            "height": (16, 8192),
            "objects": (6, 16),
            "samples": (1, 256),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ConfigError(f"room.{name} is {value}, outside {low}…{high}.")


def make_demo_capture(folder: Path, config: RoomConfig, notify: Listener = ignore) -> Path:
    """Furnish a room, walk through it with a camera, and write what it sees.

    Layout: transforms.json (nerfstudio, OpenGL camera axes, z up, metres), images/*.png, depth/*.png (16 bits,
    millimetres along the optical axis), instance/*.png (8 bits, 0 = room), labels.json (id → name),
    gt/objects/<id>.ply and gt/room.ply (complete meshes in the world), gt/points.npz (samples of them, see
    true_samples).

    Args:
        folder: new or empty.
        config: what to make.
        notify: hears one Progress a view.

    Returns:
        The folder.

    Raises:
        ExportError: the folder is not empty.
        ConfigError: the room cannot hold that many objects.
        FileError: the disk refuses.
    """
    check_new(folder)
    room = furnish_room(config.seed, config.objects)
    surfaces = gather_surfaces(room.shell, room.objects)
    cameras = camera_path(room, surfaces.scene, config.views, config.width, config.height, config.seed)
    lit = bake(surfaces, room.lights)
    _write_truth(folder, room)
    _write_samples(folder, true_samples(room, surfaces.scene, cameras, config.seed))
    # Two views at once: while one is in numpy, which uses one core, the other casts rays.
    with ThreadPoolExecutor(2) as pool:
        views = pool.map(lambda camera: render_view(lit, camera, config.samples), cameras)
        for index, view in enumerate(views):
            _write_view(folder, index, view)
            notify(Progress(stage=_STAGE, done=index + 1, total=len(cameras)))
    _write_cameras(folder, cameras)  # last: without it a reader sees no capture, rather than half of one
    return folder


def _write_truth(folder: Path, room: Room) -> None:
    write_mesh(folder / "gt" / "room.ply", mesh_of(room.shell))
    for key, model in room.objects.items():
        write_mesh(folder / "gt" / "objects" / f"{key}.ply", mesh_of(model))
    names = {0: "room"} | {key: model.name for key, model in room.objects.items()}
    write_json(folder / "labels.json", {str(key): name for key, name in names.items()})


def _write_samples(folder: Path, samples: dict[str, np.ndarray]) -> None:
    archive = io.BytesIO()
    np.savez(archive, **samples)
    write_bytes(folder / "gt" / "points.npz", archive.getvalue())


def _write_view(folder: Path, index: int, view: View) -> None:
    write_png(folder / "images" / f"{index:04}.png", view.colour)
    write_depth(folder / "depth" / f"{index:04}.png", view.depth)
    write_ids(folder / "instance" / f"{index:04}.png", view.ids)


def _write_cameras(folder: Path, cameras: tuple[Camera, ...]) -> None:
    first = cameras[0]
    frames = [
        {
            "file_path": f"images/{index:04}.png",
            "depth_file_path": f"depth/{index:04}.png",
            "instance_file_path": f"instance/{index:04}.png",
            "transform_matrix": (camera.world_from_cam.double().numpy() @ _OPENCV_FROM_OPENGL).tolist(),
        }
        for index, camera in enumerate(cameras)
    ]
    document = {
        "camera_model": "PINHOLE",
        "w": first.width,
        "h": first.height,
        "fl_x": float(first.focal_px[0]),
        "fl_y": float(first.focal_px[1]),
        "cx": float(first.centre_px[0]),
        "cy": float(first.centre_px[1]),
        "depth_unit_scale_factor": 0.001,
        "frames": frames,
    }
    write_json(folder / "transforms.json", document)
