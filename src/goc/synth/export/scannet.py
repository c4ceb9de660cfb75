"""Writes a capture as ScanNet's tools export a scene."""

from pathlib import Path

import numpy as np

from goc.files import write_bytes, write_depth, write_image, write_json, write_png
from goc.scene import ROOM, UNLABELLED, Capture
from goc.synth.export.cameras import as_text, calibration_of, pose_of


def export(capture: Capture, folder: Path) -> None:
    """Write color/, depth/, pose/, intrinsic/, instance-filt/ and an aggregation, whose last instance is the wall."""
    wall = 1 + max([0, *capture.id_names, *(int(frame.ids.max()) for frame in capture if frame.ids is not None)])
    matrix = np.eye(4)
    matrix[:3, :3] = calibration_of(capture.cameras[0])
    write_bytes(folder / "intrinsic" / "intrinsic_color.txt", as_text(matrix))
    write_bytes(folder / "intrinsic" / "intrinsic_depth.txt", as_text(matrix))
    for number, frame in enumerate(capture):
        write_image(folder / "color" / f"{number}.jpg", frame.image.numpy())
        write_bytes(folder / "pose" / f"{number}.txt", as_text(pose_of(frame.camera)))
        if frame.depth is not None:
            write_depth(folder / "depth" / f"{number}.png", frame.depth.numpy())
        if frame.ids is not None:
            ids = frame.ids.numpy()
            stored = np.where(ids == ROOM, wall, np.where(ids == UNLABELLED, 0, ids))
            write_png(folder / "instance-filt" / f"{number}.png", stored.astype(np.uint8))
    names = {key: name for key, name in capture.id_names.items() if key != ROOM} | {wall: "wall"}
    groups = [{"id": key - 1, "objectId": key - 1, "segments": [], "label": name} for key, name in names.items()]
    write_json(folder / f"{folder.name}.aggregation.json", {"sceneId": folder.name, "segGroups": groups})
