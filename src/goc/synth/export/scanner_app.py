"""3D Scanner App's export of all data."""

from pathlib import Path

from goc.files import write_bytes, write_depth, write_json, write_png
from goc.synth.export.cameras import arkit_pose_of, intrinsics_of, jpeg_of, sure_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture


def _write(room: RoomCapture, out: Path) -> None:
    """Write frame_N.json and .jpg, depth_N.png and conf_N.png; as the app does, not every frame has a photograph."""
    for number, view in enumerate(room.views):
        name = f"{3 * number:05}"  # between them are frames of which only the pose is kept
        fx, fy, cx, cy = intrinsics_of(view)
        pose = arkit_pose_of(view).reshape(-1).tolist()
        given = {"cameraPoseARFrame": pose, "intrinsics": [fx, 0, cx, 0, fy, cy, 0, 0, 1], "motionQuality": 1.0}
        write_json(out / f"frame_{name}.json", given | {"frame_index": 3 * number, "time": number / 20})
        write_json(out / f"frame_{3 * number + 1:05}.json", given | {"motionQuality": 0.9})
        write_bytes(out / f"frame_{name}.jpg", jpeg_of(view))
        write_depth(out / f"depth_{name}.png", view.depth())
        write_png(out / f"conf_{name}.png", sure_of(view.depth()))
    write_json(out / "info.json", {"title": out.name})


EXPORTER = Exporter(
    name="3d-scanner-app",
    writes="frame_N.json and .jpg, depth_N.png of 3D Scanner App, y up; no ids",
    write=_write,
    lacks=frozenset({"ids", "names"}),
)
