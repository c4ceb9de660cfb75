"""`goc carve`: a capture in, a scene and its objects out."""

import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from goc.cli.arguments import parse, parse_known
from goc.cli.failures import STOPPED, say
from goc.cli.progress import duration, shown_progress
from goc.files import layout
from goc.pipeline import PRESETS, CarveConfig, carve
from goc.runs import is_stopped_run
from goc.scene import Scene
from goc.settings import Count, Seed, Settings

_DESCRIPTION = """Turn a folder of posed photographs into a scene and separate objects.

CAPTURE is a nerfstudio folder (transforms.json) or such a file itself, or an RGB-D folder (color/, depth/, pose/).
Depth and instance ids are used where there are any; without ids, objects are told apart by their shape.

examples:
  goc carve captures/kitchen --out kitchen
  goc carve captures/kitchen/transforms_sparse.json --out sparse --iterations 1000
  goc carve captures/kitchen --out kitchen --preset paper --seed 1
  goc carve captures/kitchen --out kitchen --capture.no-use-ids --reconstruct.mcmc.max-splats 150000"""

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]


@dataclass(frozen=True, kw_only=True)
class Base:
    """The preset, which all other settings change."""

    preset: Literal["fast", "paper"] = "fast"
    """fast: minutes on two cores. paper: 30,000 iterations, colour of degree 3, labels learned: half an hour."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Base, Settings):
    """The arguments of the command line."""

    source: Annotated[Path, tyro.conf.arg(metavar="CAPTURE"), tyro.conf.Positional]
    """Folder of the capture."""
    out: Annotated[Path, tyro.conf.arg(metavar="OUT")]
    """Folder for the results: new or empty."""
    iterations: Annotated[Count | None, tyro.conf.arg(metavar="N", help_behavior_hint="")] = None
    """Optimisation steps; short for --reconstruct.iterations."""
    seed: Annotated[Seed | None, tyro.conf.arg(metavar="N", help_behavior_hint="")] = None
    """Random seed; short for --reconstruct.seed and --segment.seed."""
    overwrite: Flag = False
    """Replace what goc wrote into OUT before; other files there stay."""
    resume: Flag = False
    """Continue a stopped run of the same command."""
    stages: Annotated[CarveConfig, tyro.conf.arg(name="")] = field(default_factory=CarveConfig)

    def config(self) -> CarveConfig:
        """The settings of the stages, with the shortcuts applied."""
        reconstruct, segment, export = self.stages.reconstruct, self.stages.segment, self.stages.export
        if self.iterations is not None:
            reconstruct = replace(reconstruct, iterations=self.iterations)
        if self.seed is not None:
            reconstruct, segment = replace(reconstruct, seed=self.seed), replace(segment, seed=self.seed)
        if self.overwrite:
            export = replace(export, overwrite=True)
        return replace(self.stages, reconstruct=reconstruct, segment=segment, export=export)


def main(words: Sequence[str]) -> int:
    """Run `goc carve` with the words that follow it."""
    arguments = arguments_of(words)
    return run(arguments.source, arguments.out, arguments.config(), arguments.resume, ["carve", *words])


def arguments_of(words: Sequence[str]) -> Arguments:
    """Read the command line; the preset is read first, because it sets the defaults of other settings.

    Raises:
        ConfigError: a flag is unknown, or its value is refused.
    """
    base = parse_known(Base, words, "goc carve")
    return parse(partial(Arguments, stages=PRESETS[base.preset]), words, "goc carve", _DESCRIPTION)


def run(source: Path, out: Path, config: CarveConfig, resume: bool, command: Sequence[str]) -> int:
    """Carve, show progress, and print where the results are; `command` holds the words that run it again."""
    started = time.monotonic()
    try:
        with shown_progress() as notify:
            scene = carve(source, out, config, notify, resume)
    except KeyboardInterrupt:
        say(_how_to_go_on(out, command))
        return STOPPED
    sys.stdout.write(_summary(scene, out, time.monotonic() - started))
    return 0


def _how_to_go_on(out: Path, command: Sequence[str]) -> str:
    if not is_stopped_run(out):
        return "stopped before the first checkpoint: nothing was kept."
    again = shlex.join(["goc", *(word for word in command if word != "--resume"), "--resume"])
    return f"stopped; the last checkpoint is on disk. Continue with: {again}"


def _summary(scene: Scene, out: Path, seconds: float) -> str:
    count = len(scene.objects)
    closed = "mesh.glb, mesh.ply (closed), " if any(item.solid is not None for item in scene.objects) else ""
    lines = [
        f"{count} object{'s' * (count != 1)} in {duration(seconds)}.",
        f"  look at   {out / layout.OVERVIEW}",
        f"  scene     {out / layout.SCENE_MESH}, {out / layout.SCENE_SPLATS}",
        f"  objects   {out / 'objects'}/<id>/{closed}observed.ply, splats.ply",
        f"  figures   {out / layout.REPORT}",
    ]
    return "\n".join(lines) + "\n"
