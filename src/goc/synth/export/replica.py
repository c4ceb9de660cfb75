"""The packs in which Replica's rooms are passed on: of NICE-SLAM, and of vMAP."""

from pathlib import Path

import numpy as np

from goc.files import write_bytes, write_depth, write_json, write_png
from goc.scene import ROOM
from goc.synth.export.cameras import as_text, calibration_of, jpeg_of, names_of, steps_of, wall_of, with_wall
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture
from goc.synth.sensor.source import link

_STEPS_PER_METRE, _MILLIMETRES = 6553.5, 1000.0
_WALL_CLASS, _THING_CLASS = 93, 20


def _write(room: RoomCapture, out: Path) -> None:
    _write_cameras(room, out, "traj.txt", _STEPS_PER_METRE)
    for number, view in enumerate(room.views):
        write_bytes(out / "results" / f"frame{number:06}.jpg", jpeg_of(view))
        write_png(out / "results" / f"depth{number:06}.png", steps_of(view.depth(), _STEPS_PER_METRE))


def _write_vmap(room: RoomCapture, out: Path) -> None:
    _write_cameras(room, out, "traj_w_c.txt", _MILLIMETRES)
    wall = wall_of(room)
    for number, view in enumerate(room.views):
        link(view.image_path, out / "rgb" / f"rgb_{number}{view.image_path.suffix}")
        write_depth(out / "depth" / f"depth_{number}.png", view.depth())
        ids = view.ids()
        classes = np.where(ids == ROOM, _WALL_CLASS, np.where(ids > 0, _THING_CLASS, 0))
        write_png(out / "semantic_instance" / f"semantic_instance_{number}.png", with_wall(view, wall))
        write_png(out / "semantic_class" / f"semantic_class_{number}.png", classes.astype(np.uint16))
    things = [{"id": key, "class_name": name} for key, name in names_of(room).items()]
    write_json(out / "info_semantic.json", {"objects": things})


def _write_cameras(room: RoomCapture, out: Path, name: str, scale: float) -> None:
    """One pose a line, and cam_params.json."""
    write_bytes(out / name, as_text(np.stack([view.world_from_cam.reshape(16) for view in room.views])))
    first, matrix = room.views[0], calibration_of(room.views[0])
    given = {"w": first.width, "h": first.height, "fx": matrix[0, 0], "fy": matrix[1, 1]}
    given |= {"cx": matrix[0, 2], "cy": matrix[1, 2], "scale": scale}
    write_json(out / "cam_params.json", {"camera": given})


EXPORTER = Exporter(
    name="replica",
    writes="results/ and traj.txt of NICE-SLAM's pack; no ids",
    write=_write,
    lacks=frozenset({"ids", "names"}),
)
VMAP = Exporter(
    name="replica-vmap", writes="rgb/, depth/, semantic_instance/ and _class/ of vMAP's pack", write=_write_vmap
)
