"""`goc osc`: prepare shapes for Object Surface Completion, train its networks, score them."""

import os
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from goc.cli.arguments import parse
from goc.cli.failures import STOPPED, say
from goc.cli.progress import shown_progress
from goc.errors import ConfigError
from goc.training.calibrate import CalibrateConfig
from goc.training.config import TrainConfig
from goc.training.evaluate import EvalConfig
from goc.training.prepare import PrepareConfig

_DESCRIPTION = """Object Surface Completion: the network that fills what no camera saw.

  goc osc prepare MESHES OUT       closed shapes from meshes of any kind, in files that stream
  goc osc train OUT                train on procedural shapes, and on prepared ones with --data
  goc osc eval DATA                score weights on the prepared shapes of split val
  goc osc calibrate DATA           learn how far each candidate of `--complete.method best` can be trusted

`goc osc train OUT` again goes on with a training that was stopped. On several GPUs:
  torchrun --nproc-per-node 4 -m goc.cli osc train OUT --data DATA"""


@dataclass(frozen=True, kw_only=True)
class Prepare:
    """Turn meshes (.glb, .obj, .ply) into signed distances; goes on where it was stopped."""

    meshes: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MESHES")]
    """Folder of meshes; an objects.csv in it (file, name, split) names them and their split."""
    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="OUT")]
    """Folder for shards and manifest.json."""
    config: Annotated[PrepareConfig, tyro.conf.arg(name="")] = PrepareConfig()


@dataclass(frozen=True, kw_only=True)
class Train:
    """Train a completion network; goes on where it was stopped."""

    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="OUT")]
    """Folder for state, weights, curves and pictures."""
    config: Annotated[TrainConfig, tyro.conf.arg(name="")] = TrainConfig()


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Score weights on prepared shapes of split val, beside what needs no training."""

    data: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATA")]
    """Folder of `goc osc prepare`."""
    weights: Path | None = None
    """Weights of `goc osc train`; none: those that goc comes with."""
    baselines: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Score what needs no training alone."""
    json: Path | None = None
    """Write every score, of each mask and in the mean, to this file."""
    pictures: Path | None = None
    """Draw some cases into this PNG: seen, completed, true."""
    config: Annotated[EvalConfig, tyro.conf.arg(name="")] = EvalConfig()


@dataclass(frozen=True, kw_only=True)
class Calibrate:
    """Learn how far each candidate for what nobody saw can be trusted; needed again with other weights."""

    data: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATA")]
    """Folder of `goc osc prepare`."""
    rooms: tuple[Path, ...] = ()
    """Captures with ground truth to learn from as well, made by `goc synth room --split train`."""
    held_rooms: tuple[Path, ...] = ()
    """Captures with ground truth that test what was learnt."""
    weights: Path | None = None
    """Weights of `goc osc train`; none: those that goc comes with."""
    out: Path | None = None
    """The file to write; none: the one inside the package that `best` reads."""
    config: Annotated[CalibrateConfig, tyro.conf.arg(name="")] = CalibrateConfig()


Command = (
    Annotated[Prepare, tyro.conf.subcommand("prepare")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Evaluate, tyro.conf.subcommand("eval")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
)


def main(words: Sequence[str]) -> int:
    """Run `goc osc` with the words that follow it."""
    match parse(Command, words or ["--help"], "goc osc", _DESCRIPTION):
        case Prepare() as given:
            return _prepare(given)
        case Train() as given:
            return _train(given, words)
        case Evaluate() as given:
            return _evaluate(given)
        case Calibrate() as given:
            return _calibrate(given)


def _prepare(given: Prepare) -> int:
    from goc.training.prepare import prepare

    with shown_progress() as notify:
        manifest = prepare(given.meshes, given.out, given.config, notify)
    sys.stdout.write(f"{len(manifest.kept)} shapes in {given.out}, {len(manifest.dropped)} meshes dropped.\n")
    for mesh in manifest.dropped[:5]:
        sys.stdout.write(f"  dropped {mesh.name}: {mesh.why}\n")
    return 0


def _train(given: Train, words: Sequence[str]) -> int:
    from goc.training.train import train

    try:
        with shown_progress() as notify:
            weights = train(given.out, given.config, notify)
    except KeyboardInterrupt:
        say(f"stopped; the training is on disk. Go on with: {shlex.join(['goc', 'osc', *words])}")
        return STOPPED
    if os.environ.get("RANK", "0") == "0":
        sys.stdout.write(f"Weights: {weights}. Score them: goc osc eval DATA --weights {weights}\n")
    return 0


def _evaluate(given: Evaluate) -> int:
    from goc.complete import SHIPPED, load_network
    from goc.files import write_json
    from goc.training.evaluate import evaluate, table

    if given.baselines and given.weights is not None:
        raise ConfigError("--baselines scores no network, but --weights names one. Leave one of them out.")
    if given.pictures is not None and given.pictures.suffix.lower() != ".png":
        raise ConfigError(f"--pictures {given.pictures}: goc writes .png. Choose that.")
    network = None if given.baselines else load_network(given.weights or SHIPPED)
    with shown_progress() as notify:
        report = evaluate(given.data, network, given.config, notify, given.pictures)
    if given.json is not None:
        write_json(given.json, report)
    sys.stdout.write(table(report))
    return 0


def _calibrate(given: Calibrate) -> int:
    from goc.complete import SHIPPED, load_network
    from goc.complete.choice import CALIBRATION
    from goc.files import write_json
    from goc.training.calibrate import calibrate
    from goc.training.reliability import reliability

    network = load_network(given.weights or SHIPPED)
    with shown_progress() as notify:
        report = calibrate(given.data, given.rooms, given.held_rooms, network, given.config, notify)
    path = given.out or CALIBRATION
    write_json(path, report.calibration)
    sys.stdout.write(reliability(report.calibration, report.tested))
    sys.stdout.write(f"\nCalibration of {report.calibration.cases} cases: {path}\n")
    return 0
