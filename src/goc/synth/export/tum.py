"""TUM RGB-D: three streams with times of their own."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from goc.files import write_bytes, write_png
from goc.synth.export.cameras import as_text, calibration_of, steps_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture
from goc.synth.sensor.source import link

_STEPS_PER_METRE = 5000.0
_START_S, _STEP_S, _LATE_S = 1305031102.0, 1 / 30, 0.004


def _write(room: RoomCapture, out: Path) -> None:
    """Write rgb/, depth/, their lists, groundtruth.txt and calibration.txt; depth comes 4 ms after colour."""
    colours, depths, poses = ["# color images"], ["# depth maps"], ["# timestamp tx ty tz qx qy qz qw"]
    for number, view in enumerate(room.views):
        time = _START_S + number * _STEP_S
        colour = f"rgb/{time:.6f}{view.image_path.suffix}"
        link(view.image_path, out / colour)
        colours.append(f"{time:.6f} {colour}")
        depth = f"depth/{time + _LATE_S:.6f}.png"
        write_png(out / depth, steps_of(view.depth(), _STEPS_PER_METRE))
        depths.append(f"{time + _LATE_S:.6f} {depth}")
        pose = view.world_from_cam
        numbers = (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat())
        poses.append(" ".join([f"{time:.6f}", *(f"{value:.9g}" for value in numbers)]))
    for name, lines in {"rgb.txt": colours, "depth.txt": depths, "groundtruth.txt": poses}.items():
        write_bytes(out / name, "".join(f"{line}\n" for line in lines).encode())
    matrix = calibration_of(room.views[0])
    numbers = [[matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]]
    write_bytes(out / "calibration.txt", as_text(np.array(numbers)))


EXPORTER = Exporter(
    name="tum",
    writes="rgb/, depth/, their lists and groundtruth.txt of TUM RGB-D; no ids",
    write=_write,
    lacks=frozenset({"ids", "names"}),
)
