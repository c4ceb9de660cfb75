"""The captures of MonoSDF and its descendants, with RICO's ids."""

import io
from pathlib import Path

import numpy as np

from goc.files import write_bytes, write_json, write_png
from goc.scene import ROOM
from goc.synth.export.cameras import calibration_of, names_of, normals_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture

_ROOM_VALUE = 255


def _write(room: RoomCapture, out: Path) -> None:
    """Write N_rgb.png, N_depth.npy (exact), N_normal.npy, cameras.npz, instance_mask/ and instance_id.json."""
    centres = np.stack([view.world_from_cam[:3, 3] for view in room.views])
    scale = np.eye(4)
    scale[:3, :3] *= 1.5 * np.ptp(centres, axis=0).max()
    scale[:3, 3] = centres.mean(0)
    matrices = {}
    for number, view in enumerate(room.views):
        intrinsics = np.eye(4)
        intrinsics[:3, :3] = calibration_of(view)
        matrices[f"world_mat_{number}"] = intrinsics @ view.cam_from_world
        matrices[f"scale_mat_{number}"] = scale
        write_png(out / f"{number:06}_rgb.png", view.image())
        _write_array(out / f"{number:06}_depth.npy", np.nan_to_num(view.depth()))
        _write_array(out / f"{number:06}_normal.npy", np.moveaxis((normals_of(view) + 1) / 2, -1, 0))
        ids = view.ids()
        stored = np.where(ids <= ROOM, _ROOM_VALUE, ids)
        write_png(out / "instance_mask" / f"{number:06}.png", stored.astype(np.uint8))
    write_json(out / "instance_id.json", {name: key for key, name in names_of(room).items()})
    archive = io.BytesIO()
    np.savez(archive, **matrices)
    write_bytes(out / "cameras.npz", archive.getvalue())


def _write_array(path: Path, array: np.ndarray) -> None:
    encoded = io.BytesIO()
    np.save(encoded, array.astype(np.float32))
    write_bytes(path, encoded.getvalue())


EXPORTER = Exporter(
    name="monosdf", writes="N_rgb.png, cameras.npz, depth and normals of MonoSDF, RICO's ids", write=_write
)
