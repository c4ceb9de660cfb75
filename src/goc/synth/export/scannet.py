"""ScanNet: a scene as its tools export it, and as a .sens recording."""

import struct
import zlib
from pathlib import Path

import numpy as np

from goc.files import write_atomic, write_bytes, write_depth, write_json, write_png
from goc.synth.export.cameras import as_text, calibration_of, jpeg_of, names_of, steps_of, wall_of, with_wall
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture

_JPEG, _ZLIB = 2, 1
_MILLIMETRES = 1000.0


def _write(room: RoomCapture, out: Path) -> None:
    """Write color/, depth/, pose/, intrinsic/, instance-filt/ and an aggregation, whose last instance is the wall."""
    matrix, wall = np.eye(4), wall_of(room)
    matrix[:3, :3] = calibration_of(room.views[0])
    for name in ("color", "depth"):
        write_bytes(out / "intrinsic" / f"intrinsic_{name}.txt", as_text(matrix))
        write_bytes(out / "intrinsic" / f"extrinsic_{name}.txt", as_text(np.eye(4)))
    for number, view in enumerate(room.views):
        write_bytes(out / "color" / f"{number}.jpg", jpeg_of(view))
        write_bytes(out / "pose" / f"{number}.txt", as_text(view.world_from_cam))
        write_depth(out / "depth" / f"{number}.png", view.depth())
        write_png(out / "instance-filt" / f"{number}.png", with_wall(view, wall).astype(np.uint8))
    names = names_of(room) | {wall: "wall"}
    groups = [{"id": key - 1, "objectId": key - 1, "segments": [], "label": name} for key, name in names.items()]
    write_json(out / f"{out.name}.aggregation.json", {"sceneId": out.name, "segGroups": groups})


def _write_sens(room: RoomCapture, out: Path) -> None:
    """Write scene.sens: JPEG, depth of millimetres in zlib."""
    first, matrix = room.views[0], np.eye(4, dtype="<f4")
    matrix[:3, :3] = calibration_of(first)
    still = np.eye(4, dtype="<f4").tobytes()
    size = (first.width, first.height)
    with write_atomic(out / "scene.sens") as file:
        file.write(struct.pack("<IQ", 4, 4) + b"goc ")
        file.write(matrix.tobytes() + still + matrix.tobytes() + still)
        file.write(struct.pack("<2i4IfQ", _JPEG, _ZLIB, *size, *size, _MILLIMETRES, len(room.views)))
        for number, view in enumerate(room.views):
            colour = jpeg_of(view)
            depth = zlib.compress(steps_of(view.depth(), _MILLIMETRES).astype("<u2").tobytes())
            file.write(view.world_from_cam.astype("<f4").tobytes())
            file.write(struct.pack("<4Q", number, number, len(colour), len(depth)) + colour + depth)
        file.write(struct.pack("<Q", 0))


EXPORTER = Exporter(name="scannet", writes="color/, depth/, pose/, intrinsic/, instance-filt/ of ScanNet", write=_write)
SENS = Exporter(
    name="scannet-sens", writes="one .sens recording; no ids", write=_write_sens, lacks=frozenset({"ids", "names"})
)
