"""Writes a capture as a scan of ARKitScenes."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from goc.files import write_bytes, write_depth, write_image, write_png
from goc.scene import Capture
from goc.synth.export.cameras import as_text, intrinsics_of, pose_of

_START_S, _STEP_S = 6845.2, 0.1
_SURE = 2


def export(capture: Capture, folder: Path) -> None:
    """Write ID_frames/lowres_wide and its intrinsics, lowres_depth, confidence and the trajectory."""
    root, scan = folder / f"{folder.name}_frames", folder.name
    lines = []
    for number, frame in enumerate(capture):
        time = _START_S + number * _STEP_S
        name, camera = f"{scan}_{time:.3f}", frame.camera
        write_image(root / "lowres_wide" / f"{name}.png", frame.image.numpy())
        numbers = np.array([[camera.width, camera.height, *intrinsics_of(camera)]])
        late = f"{scan}_{time + 0.001:.3f}.pincam"  # the data set's own times differ so
        write_bytes(root / "lowres_wide_intrinsics" / late, as_text(numbers))
        inverse = np.linalg.inv(pose_of(camera))
        lines.append([time, *Rotation.from_matrix(inverse[:3, :3]).as_rotvec(), *inverse[:3, 3]])
        if frame.depth is not None:
            write_depth(root / "lowres_depth" / f"{name}.png", frame.depth.numpy())
            sure = np.where(np.isnan(frame.depth.numpy()), 0, _SURE)
            write_png(root / "confidence" / f"{name}.png", sure.astype(np.uint8))
    write_bytes(root / "lowres_wide.traj", as_text(np.array(lines)))
