"""`goc synth`: captures with complete ground truth, and faults for captures that have none."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Literal

import tyro

from goc.cli.arguments import parse
from goc.cli.progress import shown_progress
from goc.errors import ConfigError
from goc.synth.captures import RoomConfig, make_room_capture
from goc.synth.export import EXPORTERS, export_room
from goc.synth.sensor import MODELS, Faults, Lidar, MonocularDepth, SensorConfig, StructuredLight, degrade_capture

_DESCRIPTION = """Make captures with complete ground truth. `goc synth COMMAND --help` tells all settings."""
_ROOM = """Photograph a furnished room, with complete ground truth, as nerfstudio folder.

OUT gets images, exact depth and ids, transforms.json (all views), transforms_sparse.json (some), and gt/, which
goc eval reads. The room is furnished with built-in furniture, or with the .glb, .obj and .ply meshes of a folder:
large ones on the floor, small ones on them. The same seed gives the same bytes.

examples:
  goc synth room rooms/0
  goc synth room rooms/1 --seed 1 --objects 14 --normals
  goc synth room rooms/2 --seed 2 --meshes objects --split val
  goc synth room rooms/3 --meshes glb_in_cm --up y --scale 0.01
  goc synth room quick --views 12 --width 96 --height 96"""
_SENSOR = """Copy a capture (nerfstudio folder, metric depth) as an imperfect sensor would have made it.

What no fault touches is shared with CAPTURE. The same seed gives the same bytes. What OUT hides (exact poses; scale
and offset of each monocular depth image) is in OUT/gt/sensor.json.

examples:
  goc synth sensor in out --model kinect
  goc synth sensor in out --masks 0.1
  goc synth sensor in out --model monocular --monocular.normals
  goc synth sensor in out --model phone --image.blur-px 3
  goc synth sensor in out --pose.rotation-deg 0.3 --masks 0.1
  goc synth sensor in out --model kinect --kinect.jitter-px 0"""

_EXPORT = f"""Write a synthetic room in a format of other programs, to try a reader, or a converter of yours.

What is read back has the same cameras, depth and ids, as far as the format holds them.

formats:
{chr(10).join(f"  {name:20s}{exporter.writes}" for name, exporter in EXPORTERS.items())}

examples:
  goc synth export rooms/0 --format colmap --out as-colmap
  goc synth export rooms/0 --format nerfstudio-fisheye --out as-fisheye"""

_BENCHMARK_ROOM = RoomConfig(views=170, sparse_views=50, width=384, height=384, objects=10, images="jpg")


@dataclass(frozen=True, kw_only=True)
class Room:
    """Photograph a furnished room: built-in furniture, or any folder of meshes."""

    out: Annotated[Path, tyro.conf.arg(metavar="OUT"), tyro.conf.Positional]
    """Folder for the capture: new or empty."""
    room: Annotated[RoomConfig, tyro.conf.arg(name=""), tyro.conf.OmitArgPrefixes] = _BENCHMARK_ROOM


@dataclass(frozen=True, kw_only=True)
class Sensor(Faults):
    """Copy a capture as an imperfect sensor would have made it."""

    source: Annotated[Path, tyro.conf.arg(metavar="CAPTURE"), tyro.conf.Positional]
    """Folder with transforms.json, or such a file."""
    out: Annotated[Path, tyro.conf.arg(metavar="OUT"), tyro.conf.Positional]
    """Folder for the copy: new or empty."""
    model: Literal["exact", "kinect", "phone", "monocular"] = "exact"
    """What measures the depth: nothing (it stays as it is), structured light, a phone's lidar, or a network that knows
    it up to a scale and an offset of each image."""
    kinect: StructuredLight = field(default_factory=StructuredLight)
    phone: Lidar = field(default_factory=Lidar)
    monocular: MonocularDepth = field(default_factory=MonocularDepth)

    def __post_init__(self) -> None:
        """Refuse settings of a model that is not the chosen one."""
        super().__post_init__()
        for name in ("kinect", "phone", "monocular"):
            if name != self.model and getattr(self, name) != MODELS[name]:
                raise ConfigError(f"--{name}.* means nothing with --model {self.model}. Add --model {name}.")

    def config(self) -> SensorConfig:
        """The faults, with those of the chosen model."""
        depth = None if self.model == "exact" else getattr(self, self.model)
        return SensorConfig(depth=depth, **{item.name: getattr(self, item.name) for item in fields(Faults)})


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a synthetic room in another format."""

    source: Annotated[Path, tyro.conf.arg(metavar="ROOM"), tyro.conf.Positional]
    """Folder that goc synth room wrote, or one transforms file of it."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for the copy: new or empty."""
    format: Annotated[str, tyro.conf.arg(metavar="NAME")]
    """Which format: see above."""


Command = (
    Annotated[Room, tyro.conf.subcommand("room", description=_ROOM)]
    | Annotated[Sensor, tyro.conf.subcommand("sensor", description=_SENSOR)]
    | Annotated[Export, tyro.conf.subcommand("export", description=_EXPORT)]
)


def main(words: Sequence[str]) -> int:
    """Run `goc synth` with the words that follow it."""
    match parse(Command, words or ["--help"], "goc synth", _DESCRIPTION):
        case Room() as arguments:
            return _photograph(arguments)
        case Sensor() as arguments:
            return _degrade(arguments)
        case Export() as arguments:
            export_room(arguments.source, arguments.format, arguments.out)
            sys.stdout.write(f"The room is {arguments.out}; carve it: goc carve {arguments.out} --out carved\n")
            return 0


def _photograph(arguments: Room) -> int:
    with shown_progress() as notify:
        make_room_capture(arguments.out, arguments.room, notify)
    sys.stdout.write(f"The capture is {arguments.out}; carve it: goc carve {arguments.out} --out carved\n")
    return 0


def _degrade(arguments: Sensor) -> int:
    config = arguments.config()
    with shown_progress() as notify:
        degrade_capture(arguments.source, arguments.out, config, notify)
    sys.stdout.write(f"The copy is {arguments.out}; carve it: goc carve {arguments.out} --out carved\n")
    return 0
