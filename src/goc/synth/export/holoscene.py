"""HoloScene's captures: transforms.json, and depth and normals as networks guess them."""

import io
from pathlib import Path

import numpy as np

from goc.files import write_bytes, write_json, write_normals, write_png
from goc.scene import ROOM
from goc.synth.export.cameras import intrinsics_of, normals_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture
from goc.synth.sensor.source import link

_ROOM_VALUE = 255
_PRIOR = "marigold_ft"


def _write(room: RoomCapture, out: Path) -> None:
    frames = []
    for view in room.views:
        image = f"images/{view.name}{view.image_path.suffix}"
        link(view.image_path, out / image)
        frames.append({"file_path": image, "transform_matrix": view.opengl_pose.tolist()})
        encoded = io.BytesIO()
        np.save(encoded, np.nan_to_num(view.depth()).astype(np.float32))
        write_bytes(out / _PRIOR / "depth" / f"{view.name}.npy", encoded.getvalue())
        write_normals(out / _PRIOR / "normal" / f"{view.name}.png", normals_of(view))
        ids = view.ids()
        stored = np.where(ids <= ROOM, _ROOM_VALUE, ids - 1)
        write_png(out / "instance_mask" / f"{view.name}.png", stored.astype(np.uint8))
    first = room.views[0]
    shared = dict(zip(("fl_x", "fl_y", "cx", "cy"), intrinsics_of(first), strict=True))
    write_json(out / "transforms.json", {**shared, "w": first.width, "h": first.height, "frames": frames})


EXPORTER = Exporter(
    name="holoscene",
    writes="transforms.json, instance_mask/, depth and normals of HoloScene",
    write=_write,
    lacks=frozenset({"names", "metres"}),
)
