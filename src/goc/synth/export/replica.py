"""Writes a capture in the packs in which Replica's rooms are passed on: of NICE-SLAM, and of vMAP."""

from pathlib import Path

import numpy as np

from goc.files import write_bytes, write_depth, write_image, write_json, write_png
from goc.scene import ROOM, Capture
from goc.synth.export.cameras import as_text, calibration_of, pose_of

_STEPS_PER_METRE = 6553.5
_WALL_CLASS, _THING_CLASS = 93, 20


def export(capture: Capture, folder: Path) -> None:
    """Write NICE-SLAM's pack: results/, traj.txt and cam_params.json. It has no ids."""
    _write_cameras(capture, folder, "traj.txt", _STEPS_PER_METRE)
    for number, frame in enumerate(capture):
        write_image(folder / "results" / f"frame{number:06}.jpg", frame.image.numpy())
        if frame.depth is not None:
            steps = np.nan_to_num(frame.depth.numpy()) * _STEPS_PER_METRE
            kept = np.where(steps <= np.iinfo(np.uint16).max, np.rint(steps), 0)
            write_png(folder / "results" / f"depth{number:06}.png", kept.astype(np.uint16))


def export_vmap(capture: Capture, folder: Path) -> None:
    """Write vMAP's pack: rgb/, depth/, semantic_instance/, semantic_class/ and traj_w_c.txt."""
    _write_cameras(capture, folder, "traj_w_c.txt", 1000.0)
    wall = 1 + max([0, *(int(frame.ids.max()) for frame in capture if frame.ids is not None)])
    for number, frame in enumerate(capture):
        write_image(folder / "rgb" / f"rgb_{number}.png", frame.image.numpy())
        if frame.depth is not None:
            write_depth(folder / "depth" / f"depth_{number}.png", frame.depth.numpy())
        if frame.ids is not None:
            ids = frame.ids.numpy()
            stored = np.where(ids == ROOM, wall, np.maximum(ids, 0))
            classes = np.where(ids == ROOM, _WALL_CLASS, np.where(ids > 0, _THING_CLASS, 0))
            write_png(folder / "semantic_instance" / f"semantic_instance_{number}.png", stored.astype(np.uint16))
            write_png(folder / "semantic_class" / f"semantic_class_{number}.png", classes.astype(np.uint16))
    things = [{"id": key, "class_name": name} for key, name in capture.id_names.items() if key != ROOM]
    write_json(folder / "info_semantic.json", {"objects": things})


def _write_cameras(capture: Capture, folder: Path, name: str, scale: float) -> None:
    lines = np.stack([pose_of(camera).reshape(16) for camera in capture.cameras])
    write_bytes(folder / name, as_text(lines))
    camera, matrix = capture.cameras[0], calibration_of(capture.cameras[0])
    given = {"w": camera.width, "h": camera.height, "fx": matrix[0, 0], "fy": matrix[1, 1]}
    given |= {"cx": matrix[0, 2], "cy": matrix[1, 2], "scale": scale}
    write_json(folder / "cam_params.json", {"camera": given})
