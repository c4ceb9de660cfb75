"""The layout of 7-Scenes, with registered depth as 3DMatch has it."""

from pathlib import Path

from goc.files import write_bytes, write_depth, write_png
from goc.synth.export.cameras import as_text, calibration_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture


def _write(room: RoomCapture, out: Path) -> None:
    for number, view in enumerate(room.views):
        stem = f"frame-{number:06}"
        write_png(out / "seq-01" / f"{stem}.color.png", view.image())
        write_depth(out / "seq-01" / f"{stem}.depth.png", view.depth())
        write_bytes(out / "seq-01" / f"{stem}.pose.txt", as_text(view.world_from_cam))
    write_bytes(out / "camera-intrinsics.txt", as_text(calibration_of(room.views[0])))


EXPORTER = Exporter(
    name="7-scenes",
    writes="frame-N.color.png, .depth.png and .pose.txt, registered (3DMatch); no ids",
    write=_write,
    lacks=frozenset({"ids", "names"}),
)
