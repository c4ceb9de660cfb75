"""Writes a capture as 3D Scanner App exports all data."""

from pathlib import Path

import numpy as np

from goc.files import write_depth, write_image, write_json, write_png
from goc.scene import Capture
from goc.synth.export.cameras import arkit_pose_of, intrinsics_of

_SURE = 2


def export(capture: Capture, folder: Path) -> None:
    """Write frame_N.json and .jpg, depth_N.png and conf_N.png; as the app does, not every frame has a photograph."""
    for number, frame in enumerate(capture):
        name = f"{3 * number:05}"  # between them are frames of which only the pose is kept
        fx, fy, cx, cy = intrinsics_of(frame.camera)
        pose = arkit_pose_of(frame.camera).reshape(-1).tolist()
        given = {"cameraPoseARFrame": pose, "intrinsics": [fx, 0, cx, 0, fy, cy, 0, 0, 1], "motionQuality": 1.0}
        write_json(folder / f"frame_{name}.json", given | {"frame_index": 3 * number, "time": number / 20})
        write_json(folder / f"frame_{3 * number + 1:05}.json", given | {"motionQuality": 0.9})
        write_image(folder / f"frame_{name}.jpg", frame.image.numpy())
        if frame.depth is not None:
            write_depth(folder / f"depth_{name}.png", frame.depth.numpy())
            sure = np.where(np.isnan(frame.depth.numpy()), 0, _SURE)
            write_png(folder / f"conf_{name}.png", sure.astype(np.uint8))
    write_json(folder / "info.json", {"title": folder.name})
