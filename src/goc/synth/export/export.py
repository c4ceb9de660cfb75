"""The table of formats, and the function that writes one."""

from pathlib import Path

from goc.errors import ConfigError
from goc.synth.export import colmap, instant_ngp, metashape, nerfstudio, realitycapture
from goc.synth.export.exporter import Exporter
from goc.synth.export.recordings import RECORDINGS
from goc.synth.export.room import read_room
from goc.synth.folders import check_new

_ALL: tuple[Exporter, ...] = (
    nerfstudio.EXPORTER,
    nerfstudio.FISHEYE,
    instant_ngp.EXPORTER,
    instant_ngp.BLENDER,
    colmap.BINARY,
    colmap.TEXT,
    metashape.EXPORTER,
    realitycapture.EXPORTER,
    *RECORDINGS,
)
EXPORTERS: dict[str, Exporter] = {exporter.name: exporter for exporter in _ALL}
"""By name, in the order in which help lists them."""


def export_room(source: Path, name: str, out: Path) -> Path:
    """Write a synthetic room in another format.

    Args:
        source: folder that `goc synth room` wrote.
        name: key of EXPORTERS.
        out: new or empty folder.

    Raises:
        ConfigError: no format of that name.
        CaptureError: `source` is no synthetic room.
        ExportError: `out` is not empty.
        FileError: a file is malformed, or the disk refuses.
    """
    if name not in EXPORTERS:
        raise ConfigError(f"--format {name} is not known. Choose from {', '.join(EXPORTERS)}.")
    check_new(out)
    EXPORTERS[name].write(read_room(source), out)
    return out
