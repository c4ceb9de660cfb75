"""`goc synth`: captures with complete ground truth, and faults for captures that have none."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from goc.cli.progress import shown_progress
from goc.errors import ConfigError
from goc.synth.assets import MeshFolder
from goc.synth.captures import RoomConfig, make_room_capture
from goc.synth.sensor import (
    ImageFaults,
    Lidar,
    MonocularDepth,
    PoseFaults,
    SensorConfig,
    StructuredLight,
    degrade_capture,
)

_USAGE = """\
usage: goc synth [--help] COMMAND ...

Make captures with complete ground truth.

commands:
  room OUT              photograph a furnished room: built-in furniture, or any folder of meshes
  sensor CAPTURE OUT    copy a capture as an imperfect sensor would have made it

`goc synth COMMAND --help` tells all settings.
"""
_ROOM = """Photograph a furnished room, with complete ground truth, as nerfstudio folder.

OUT gets images, exact depth and ids, transforms.json (all views), transforms_sparse.json (some), and gt/ for
`goc eval`. The room is furnished with built-in furniture, or with the .glb, .obj and .ply meshes of a folder: large
ones on the floor, small ones on them. The same seed gives the same bytes.

examples:
  goc synth room rooms/0
  goc synth room rooms/1 --seed 1 --objects 14 --normals
  goc synth room rooms/2 --seed 2 --meshes objects --split val
  goc synth room rooms/3 --meshes downloads --up y --scale 0.01      GLB files, y up, in centimetres
  goc synth room tiny --views 12 --width 96 --height 96              for a quick look"""
_SENSOR = """Copy a capture (nerfstudio folder, metric depth) as an imperfect sensor would have made it.

What no fault touches is shared with CAPTURE. The same seed gives the same bytes. What OUT hides (exact poses; scale
and offset of each monocular depth image) is in OUT/gt/sensor.json.

examples:
  goc synth sensor room noisy --model kinect
  goc synth sensor room guessed --model monocular --monocular.normals
  goc synth sensor room masks --masks 0.1
  goc synth sensor room all --model phone --image.blur-px 3 --image.exposure-ev 0.3 --pose.rotation-deg 0.3 \\
      --pose.translation-m 0.005 --masks 0.1
  goc synth sensor room only-noise --model kinect --kinect.disparity-step 0 --kinect.jitter-px 0 \\
      --kinect.grazing-deg 90 --kinect.edge-holes 0"""


@dataclass(frozen=True, kw_only=True)
class Photographs(RoomConfig):
    """RoomConfig with the defaults of a benchmark room."""

    views: int = 170
    sparse_views: int = 50
    width: int = 384
    height: int = 384
    objects: int = 10
    images: Literal["png", "jpg"] = "jpg"
    meshes: tyro.conf.Suppress[MeshFolder | None] = None


@dataclass(frozen=True, kw_only=True)
class Meshes(MeshFolder):
    """MeshFolder where there may be none."""

    folder: Annotated[Path | None, tyro.conf.arg(name="meshes", metavar="FOLDER", help_behavior_hint="")] = None
    """Furnish the room with the meshes of this folder and its folders; the settings below are for them."""


@dataclass(frozen=True, kw_only=True)
class RoomArguments:
    """What stands behind `goc synth room`."""

    out: Annotated[Path, tyro.conf.arg(metavar="OUT"), tyro.conf.Positional]
    """Folder for the capture: new or empty."""
    room: Annotated[Photographs, tyro.conf.arg(name="")] = field(default_factory=Photographs)
    meshes: Annotated[Meshes, tyro.conf.arg(name="")] = field(default_factory=Meshes)

    def config(self) -> RoomConfig:
        """The settings of both groups as one; refuses settings for meshes without meshes."""
        if self.meshes.folder is not None:
            return replace(self.room, meshes=self.meshes)
        if self.meshes != Meshes():
            raise ConfigError("--split, --up, --scale, --min-m and --max-m are for meshes. Add --meshes FOLDER.")
        return self.room


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """What stands behind `goc synth sensor`."""

    source: Annotated[Path, tyro.conf.arg(metavar="CAPTURE"), tyro.conf.Positional]
    """Folder with transforms.json, or such a file."""
    out: Annotated[Path, tyro.conf.arg(metavar="OUT"), tyro.conf.Positional]
    """Folder for the copy: new or empty."""
    model: Literal["exact", "kinect", "phone", "monocular"] = "exact"
    """What measures the depth: nothing (it stays as it is), structured light, a phone's lidar, or a network that knows
    it up to a scale and an offset of each image."""
    masks: float = 0.0
    """Share of each view's masks that are swapped, dropped, dilated or eroded."""
    seed: int = 0
    """Of all randomness."""
    kinect: StructuredLight = field(default_factory=StructuredLight)
    phone: Lidar = field(default_factory=Lidar)
    monocular: MonocularDepth = field(default_factory=MonocularDepth)
    image: ImageFaults = field(default_factory=ImageFaults)
    pose: PoseFaults = field(default_factory=PoseFaults)

    def config(self) -> SensorConfig:
        """The faults; refuses settings of a model that is not the chosen one."""
        models = {"kinect": self.kinect, "phone": self.phone, "monocular": self.monocular}
        for name, model in models.items():
            if name != self.model and model != type(model)():
                raise ConfigError(f"--{name}.* means nothing with --model {self.model}. Add --model {name}.")
        return SensorConfig(
            seed=self.seed, depth=models.get(self.model), image=self.image, pose=self.pose, masks=self.masks
        )


def main(words: Sequence[str]) -> int:
    """Run `goc synth` with the words that follow it."""
    match list(words):
        case [] | ["-h" | "--help" | "help", *_]:
            sys.stdout.write(_USAGE)
            return 0
        case ["room", *rest]:
            return _photograph(tyro.cli(RoomArguments, prog="goc synth room", description=_ROOM, args=rest))
        case ["sensor", *rest]:
            return _degrade(tyro.cli(Sensor, prog="goc synth sensor", description=_SENSOR, args=rest))
    raise ConfigError(f"no command `goc synth {words[0]}`. `goc synth --help` tells what there is.")


def _photograph(arguments: RoomArguments) -> int:
    with shown_progress() as notify:
        make_room_capture(arguments.out, arguments.config(), notify)
    sys.stdout.write(f"The capture is {arguments.out}; carve it: goc carve {arguments.out} --out carved\n")
    return 0


def _degrade(arguments: Sensor) -> int:
    config = arguments.config()
    with shown_progress() as notify:
        degrade_capture(arguments.source, arguments.out, config, notify)
    sys.stdout.write(f"The copy is {arguments.out}; carve it: goc carve {arguments.out} --out carved\n")
    return 0
