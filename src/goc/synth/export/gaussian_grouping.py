"""Gaussian Grouping and ObjectGS: COLMAP's model, and ids in object_mask/."""

import shutil
from pathlib import Path

from goc.synth.export import colmap
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture


def _write(room: RoomCapture, out: Path) -> None:
    colmap.BINARY.write(room, out)
    (out / "instance").rename(out / "object_mask")
    (out / "labels.json").unlink()
    shutil.rmtree(out / "stereo")


EXPORTER = Exporter(
    name="gaussian-grouping",
    writes="images/, sparse/0 and object_mask/; no depth",
    write=_write,
    lacks=frozenset({"depth", "names", "metres"}),
)
