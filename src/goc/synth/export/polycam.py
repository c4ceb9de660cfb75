"""Writes a capture as Polycam's raw data, as it is before Polycam's own alignment."""

from pathlib import Path

import numpy as np

from goc.files import write_depth, write_image, write_json, write_png
from goc.scene import Capture
from goc.synth.export.cameras import arkit_pose_of, intrinsics_of

_START_US, _STEP_US = 8_120_000_000, 250_000


def export(capture: Capture, folder: Path) -> None:
    """Write keyframes/images, cameras, depth and confidence; files are named by their time."""
    root = folder / "keyframes"
    for number, frame in enumerate(capture):
        name, camera = str(_START_US + number * _STEP_US), frame.camera
        write_image(root / "images" / f"{name}.jpg", frame.image.numpy())
        fx, fy, cx, cy = intrinsics_of(camera)
        pose = arkit_pose_of(camera)
        given = {f"t_{row}{column}": pose[row, column] for row in range(3) for column in range(4)}
        given |= {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "width": camera.width, "height": camera.height}
        write_json(root / "cameras" / f"{name}.json", given | {"blur_score": 50.0, "timestamp": int(name)})
        if frame.depth is not None:
            write_depth(root / "depth" / f"{name}.png", frame.depth.numpy())
            sure = np.where(np.isnan(frame.depth.numpy()), 0, 255)
            write_png(root / "confidence" / f"{name}.png", sure.astype(np.uint8))
