"""A capture of a furnished room, photographed on the fly, written as a nerfstudio folder with complete ground truth."""

import io
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from goc.errors import ConfigError
from goc.events import Listener, Progress, Warned, ignore
from goc.files import write_bytes, write_depth, write_ids, write_image, write_json, write_mesh, write_normals
from goc.scene import Camera
from goc.settings import Range, Seed, Settings
from goc.synth.assets import MeshFolder
from goc.synth.cameras import camera_path
from goc.synth.folders import check_new
from goc.synth.lighting import bake
from goc.synth.mesh_room import furnish_with_meshes
from goc.synth.model import mesh_of
from goc.synth.render import RenderedView, render_view
from goc.synth.room import FurnishedRoom, furnish_room
from goc.synth.surfaces import gather_surfaces
from goc.synth.truth import true_samples

_STAGE = "synth"
_BUILT_IN = (6, 16)
"""Least and greatest number of things in a room with built-in furniture."""
# y and z of camera axes change their signs between OpenCV (goc) and OpenGL (nerfstudio).
_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class RoomConfig(Settings):
    """A capture of a furnished room. The same settings (and meshes) give the same bytes."""

    seed: Seed = 0
    """Chooses the room, its things, and the way through it."""
    views: Annotated[int, Range(least=8, most=100_000)] = 60
    """Number of photographs."""
    sparse_views: Annotated[int, Range(least=0, most=100_000)] = 0
    """Number of them, spread evenly, that transforms_sparse.json lists (all where there are fewer); 0: no such file."""
    width: Annotated[int, Range(least=16, most=8192)] = 320
    """Width of the photographs, pixels."""
    height: Annotated[int, Range(least=16, most=8192)] = 240
    """Height of the photographs, pixels."""
    objects: Annotated[int, Range(least=2, most=40)] = 12
    """Number of things in the room: 6 to 16 built-in ones, 2 to 40 from meshes; large numbers do not fit every room."""
    samples: Annotated[int, Range(least=1, most=256)] = 4
    """Light rays a pixel: more make shadows smoother and rendering slower."""
    images: Literal["png", "jpg"] = "png"
    """Format of the photographs; jpg is lossy and a fifth of the size."""
    normals: bool = False
    """Write exact normals too, in camera axes."""
    furniture: MeshFolder = field(default_factory=MeshFolder)
    """Meshes instead of built-in furniture."""

    def __post_init__(self) -> None:
        """Refuse numbers of things that built-in rooms cannot hold."""
        super().__post_init__()
        few, many = _BUILT_IN
        if self.furniture.meshes is None and not few <= self.objects <= many:
            text = f"{{objects}} is {self.objects}: built-in rooms have {few} to {many}. Give meshes for others."
            raise ConfigError(text, type(self))


def make_room_capture(folder: Path, config: RoomConfig, notify: Listener = ignore) -> Path:
    """Furnish a room, walk through it with a camera, and write what it sees.

    Layout: transforms.json (nerfstudio, OpenGL camera axes, z up, metres), images/*, depth/*.png (16 bits,
    millimetres along the optical axis), instance/*.png (8 bits, 0 = room), labels.json (id → name),
    gt/objects/<id>.ply and gt/room.ply (complete meshes in the world), gt/points.npz (samples of them, see
    true_samples); normal/*.png and transforms_sparse.json where they are asked for.

    Args:
        folder: new or empty.
        config: what to make.
        notify: hears one Progress a view, and of meshes that are left out.

    Returns:
        The folder.

    Raises:
        ExportError: the folder is not empty.
        ConfigError: the room cannot hold that many objects.
        FileError: there are no meshes, or the disk refuses.
    """
    check_new(folder)
    if config.furniture.meshes is None:
        room = furnish_room(config.seed, config.objects)
    else:
        room = furnish_with_meshes(config.seed, config.objects, config.furniture, notify)
    surfaces = gather_surfaces(room.shell, room.objects)
    cameras = camera_path(room, surfaces.scene, config.views, config.width, config.height, config.seed)
    lit = bake(surfaces, room.lights)
    _write_truth(folder, room)
    _write_samples(folder, true_samples(room, surfaces.scene, cameras, config.seed))
    unseen = set(room.objects)
    # Two views at once: while one is in numpy, which uses one core, the other casts rays.
    with ThreadPoolExecutor(2) as pool:
        views = pool.map(lambda camera: render_view(lit, camera, config.samples), cameras)
        for index, view in enumerate(views):
            _write_view(folder, index, view, config)
            unseen -= set(np.unique(view.ids).tolist())
            notify(Progress(stage=_STAGE, done=index + 1, total=len(cameras)))
    if unseen:
        names = ", ".join(room.objects[key].name for key in sorted(unseen))
        notify(Warned(stage=_STAGE, message=f"{len(unseen)} things are in no view: {names}. Ask for more --views."))
    _write_cameras(folder, cameras, config)  # last: without it a reader sees no capture, rather than half of one
    return folder


def _write_truth(folder: Path, room: FurnishedRoom) -> None:
    write_mesh(folder / "gt" / "room.ply", mesh_of(room.shell))
    for key, model in room.objects.items():
        write_mesh(folder / "gt" / "objects" / f"{key}.ply", mesh_of(model))
    names = {0: "room"} | {key: model.name for key, model in room.objects.items()}
    write_json(folder / "labels.json", {str(key): name for key, name in names.items()})


def _write_samples(folder: Path, samples: dict[str, np.ndarray]) -> None:
    archive = io.BytesIO()
    np.savez(archive, **samples)
    write_bytes(folder / "gt" / "points.npz", archive.getvalue())


def _write_view(folder: Path, index: int, view: RenderedView, config: RoomConfig) -> None:
    write_image(folder / "images" / f"{index:04}.{config.images}", view.colour)
    write_depth(folder / "depth" / f"{index:04}.png", view.depth)
    write_ids(folder / "instance" / f"{index:04}.png", view.ids)
    if config.normals:
        write_normals(folder / "normal" / f"{index:04}.png", view.normals)


def _write_cameras(folder: Path, cameras: tuple[Camera, ...], config: RoomConfig) -> None:
    first = cameras[0]
    document: dict[str, Any] = {
        "camera_model": "PINHOLE",
        "w": first.width,
        "h": first.height,
        "fl_x": float(first.focal_px[0]),
        "fl_y": float(first.focal_px[1]),
        "cx": float(first.centre_px[0]),
        "cy": float(first.centre_px[1]),
        "depth_unit_scale_factor": 0.001,
    }
    frames = [_frame(index, camera, config) for index, camera in enumerate(cameras)]
    if config.sparse_views:
        chosen = np.rint(np.linspace(0, len(frames) - 1, min(config.sparse_views, len(frames)))).astype(int)
        write_json(folder / "transforms_sparse.json", document | {"frames": [frames[index] for index in chosen]})
    write_json(folder / "transforms.json", document | {"frames": frames})


def _frame(index: int, camera: Camera, config: RoomConfig) -> dict[str, Any]:
    normals = {"normal_file_path": f"normal/{index:04}.png"} if config.normals else {}
    return {
        "file_path": f"images/{index:04}.{config.images}",
        "depth_file_path": f"depth/{index:04}.png",
        "instance_file_path": f"instance/{index:04}.png",
        **normals,
        "transform_matrix": (camera.world_from_cam.double().numpy() @ _OPENCV_FROM_OPENGL).tolist(),
    }
