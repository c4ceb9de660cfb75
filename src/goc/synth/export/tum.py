"""Writes a capture as a TUM RGB-D sequence: three streams with times of their own."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from goc.files import write_bytes, write_image, write_png
from goc.scene import Capture
from goc.synth.export.cameras import as_text, calibration_of, pose_of

_STEPS_PER_METRE = 5000.0
_START_S, _STEP_S, _LATE_S = 1305031102.0, 1 / 30, 0.004


def export(capture: Capture, folder: Path) -> None:
    """Write rgb/, depth/, their lists, groundtruth.txt and calibration.txt; depth comes 4 ms after colour."""
    colours, depths, poses = ["# color images"], ["# depth maps"], ["# timestamp tx ty tz qx qy qz qw"]
    for number, frame in enumerate(capture):
        time = _START_S + number * _STEP_S
        name = f"rgb/{time:.6f}.png"
        write_image(folder / name, frame.image.numpy())
        colours.append(f"{time:.6f} {name}")
        pose = pose_of(frame.camera)
        numbers = (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat())
        poses.append(" ".join([f"{time:.6f}", *(f"{value:.9g}" for value in numbers)]))
        if frame.depth is not None:
            name = f"depth/{time + _LATE_S:.6f}.png"
            steps = np.rint(np.nan_to_num(frame.depth.numpy()) * _STEPS_PER_METRE)
            write_png(folder / name, np.where(steps <= np.iinfo(np.uint16).max, steps, 0).astype(np.uint16))
            depths.append(f"{time + _LATE_S:.6f} {name}")
    for name, lines in {"rgb.txt": colours, "depth.txt": depths, "groundtruth.txt": poses}.items():
        write_bytes(folder / name, "".join(f"{line}\n" for line in lines).encode())
    matrix = calibration_of(capture.cameras[0])
    numbers = [[matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]]
    write_bytes(folder / "calibration.txt", as_text(np.array(numbers)))
