"""RealityCapture's registration as .csv."""

from pathlib import Path

import numpy as np
from jaxtyping import Float64

from goc.files import write_bytes, write_json
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture, RoomView
from goc.synth.sensor.source import link

_HEADER = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
_FILM_MM = 36.0


def _write(room: RoomCapture, out: Path) -> None:
    lines = [_HEADER]
    for view in room.views:
        link(view.image_path, out / "images" / view.image_path.name)
        link(view.ids_path, out / "instance" / f"{view.name}.png")
        lines.append(",".join([view.image_path.name, *(f"{value:.12f}" for value in _numbers(view))]))
    write_bytes(out / "cameras.csv", ("\n".join(lines) + "\n").encode())
    write_json(out / "labels.json", {str(key): name for key, name in room.names.items()})


def _numbers(view: RoomView) -> list[float]:
    side = max(view.width, view.height)
    x, y = ((centre - size / 2) / side for centre, size in zip(view.centre_px, (view.width, view.height), strict=True))
    angles = np.degrees(_angles(view.opengl_pose[:3, :3]))
    return [*view.world_from_cam[:3, 3], *angles, view.focal_px[0] * _FILM_MM / side, x, y, *[0.0] * 6]


def _angles(rotation: Float64[np.ndarray, "3 3"]) -> tuple[float, float, float]:
    """Heading, pitch and roll, radians, of rotation = Rz(-heading) Rx(pitch) Ry(roll)."""
    pitch = np.arcsin(np.clip(rotation[2, 1], -1, 1))
    heading = np.arctan2(rotation[0, 1], rotation[1, 1])
    roll = np.arctan2(-rotation[2, 0], rotation[2, 2])
    return heading, pitch, roll


EXPORTER = Exporter(
    name="realitycapture",
    writes="cameras.csv, ids in instance/",
    write=_write,
    lacks=frozenset({"depth", "metres"}),
)
