"""nerfstudio's ancestors: instant-ngp's transforms.json, and NeRF's transforms_train.json from Blender."""

import math
from pathlib import Path
from typing import Any

from goc.files import write_json
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture, RoomView
from goc.synth.sensor.source import link


def _write(room: RoomCapture, out: Path) -> None:
    first = room.views[0]
    (fl_x, fl_y), (cx, cy) = first.focal_px, first.centre_px
    document: dict[str, Any] = {"fl_x": fl_x, "fl_y": fl_y, "cx": cx, "cy": cy, "w": first.width, "h": first.height}
    document |= {"aabb_scale": 4, "scale": 0.33, "offset": [0.5, 0.5, 0.5], "enable_depth_loading": True}
    frames = [_frame(view, out) | {"depth_path": f"depth/{view.name}.png"} for view in room.views]
    for view in room.views:
        link(view.depth_path, out / "depth" / f"{view.name}.png")
    write_json(out / "transforms.json", document | {"integer_depth_scale": 0.001, "frames": frames})


def _write_blender(room: RoomCapture, out: Path) -> None:
    first = room.views[0]
    angles = {"camera_angle_x": 2 * math.atan(first.width / 2 / first.focal_px[0])}
    frames = [_frame(view, out) for view in room.views]
    for frame in frames:
        frame["file_path"] = "./" + str(Path(frame["file_path"]).with_suffix(""))
    write_json(out / "transforms_train.json", angles | {"frames": frames})


def _frame(view: RoomView, out: Path) -> dict[str, Any]:
    """A frame with its image and ids."""
    link(view.image_path, out / "images" / view.image_path.name)
    link(view.ids_path, out / "instance" / f"{view.name}.png")
    return {"file_path": f"images/{view.image_path.name}", "transform_matrix": view.opengl_pose.tolist()}


EXPORTER = Exporter(
    name="instant-ngp",
    writes="transforms.json with depth_path, ids in instance/",
    write=_write,
    lacks=frozenset({"names"}),
)
BLENDER = Exporter(
    name="blender",
    writes="transforms_train.json of NeRF's Blender scenes, ids in instance/",
    write=_write_blender,
    lacks=frozenset({"depth", "names", "metres"}),
)
