"""`goc synth`: captures with complete ground truth, and faults for captures that have none."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from goc.cli.progress import shown_progress
from goc.errors import ConfigError
from goc.synth.sensor import (
    ImageFaults,
    Lidar,
    Monocular,
    PoseFaults,
    SensorConfig,
    StructuredLight,
    degrade_capture,
)

_USAGE = """\
usage: goc synth [--help] COMMAND ...

Make captures with complete ground truth.

commands:
  sensor CAPTURE OUT    copy a capture as an imperfect sensor would have made it

`goc synth COMMAND --help` tells all settings.
"""
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
    monocular: Monocular = field(default_factory=Monocular)
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
        case ["sensor", *rest]:
            return _degrade(tyro.cli(Sensor, prog="goc synth sensor", description=_SENSOR, args=rest))
    raise ConfigError(f"no command `goc synth {words[0]}`. `goc synth --help` tells what there is.")


def _degrade(arguments: Sensor) -> int:
    config = arguments.config()
    with shown_progress() as notify:
        degrade_capture(arguments.source, arguments.out, config, notify)
    sys.stdout.write(f"The copy is {arguments.out}; carve it: goc carve {arguments.out} --out carved\n")
    return 0
