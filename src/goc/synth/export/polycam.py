"""Polycam's raw data, as they are before Polycam's own alignment."""

from pathlib import Path

from goc.files import write_bytes, write_depth, write_json, write_png
from goc.synth.export.cameras import arkit_pose_of, intrinsics_of, jpeg_of, sure_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture

_START_US, _STEP_US = 8_120_000_000, 250_000
_SURE = 255


def _write(room: RoomCapture, out: Path) -> None:
    """Write keyframes/images, cameras, depth and confidence; files are named by their time."""
    root = out / "keyframes"
    for number, view in enumerate(room.views):
        name, pose = str(_START_US + number * _STEP_US), arkit_pose_of(view)
        fx, fy, cx, cy = intrinsics_of(view)
        given = {f"t_{row}{column}": pose[row, column] for row in range(3) for column in range(4)}
        given |= {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "width": view.width, "height": view.height}
        write_json(root / "cameras" / f"{name}.json", given | {"blur_score": 50.0, "timestamp": int(name)})
        write_bytes(root / "images" / f"{name}.jpg", jpeg_of(view))
        write_depth(root / "depth" / f"{name}.png", view.depth())
        write_png(root / "confidence" / f"{name}.png", sure_of(view.depth(), _SURE))


EXPORTER = Exporter(
    name="polycam",
    writes="keyframes/ of Polycam's raw data, y up; no ids",
    write=_write,
    lacks=frozenset({"ids", "names"}),
)
