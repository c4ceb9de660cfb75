"""A scene of the BOP challenge: millimetres, one mask an object."""

from pathlib import Path

import numpy as np

from goc.files import write_bytes, write_depth, write_json, write_png
from goc.synth.export.cameras import calibration_of, jpeg_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture, RoomView

_MILLIMETRES = 1000.0


def _write(room: RoomCapture, out: Path) -> None:
    cameras, truth = {}, {}
    for number, view in enumerate(room.views):
        write_bytes(out / "rgb" / f"{number:06}.jpg", jpeg_of(view))
        write_depth(out / "depth" / f"{number:06}.png", view.depth())
        inverse = view.cam_from_world
        cameras[str(number)] = {
            "cam_K": calibration_of(view).reshape(-1).tolist(),
            "depth_scale": 1.0,
            "cam_R_w2c": inverse[:3, :3].reshape(-1).tolist(),
            "cam_t_w2c": (inverse[:3, 3] * _MILLIMETRES).tolist(),
        }
        truth[str(number)] = _entries(view, number, out)
    write_json(out / "scene_camera.json", cameras)
    write_json(out / "scene_gt.json", truth)


def _entries(view: RoomView, number: int, out: Path) -> list[dict[str, object]]:
    """Objects of a view, their masks written; models stand apart from one another along x, as their origins do."""
    ids, entries = view.ids(), []
    for index, key in enumerate(int(value) for value in np.unique(ids) if value > 0):
        model = view.cam_from_world @ np.array([key, 0.0, 0.0, 1.0])
        turn = view.cam_from_world[:3, :3].reshape(-1).tolist()
        entries.append({"obj_id": key, "cam_R_m2c": turn, "cam_t_m2c": (model[:3] * _MILLIMETRES).tolist()})
        mask = np.where(ids == key, 255, 0).astype(np.uint8)
        write_png(out / "mask_visib" / f"{number:06}_{index:06}.png", mask)
    return entries


EXPORTER = Exporter(
    name="bop",
    writes="scene_camera.json, scene_gt.json, rgb/, depth/, mask_visib/ of BOP; no names",
    write=_write,
    lacks=frozenset({"names"}),
)
