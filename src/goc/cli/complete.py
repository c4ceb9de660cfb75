"""`goc complete`: one partial scan in, a closed mesh out."""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from goc.cli.arguments import parse
from goc.cli.progress import duration, shown_progress
from goc.complete import ClosedScan, ScanConfig, complete_scan
from goc.errors import ConfigError
from goc.files import read_scan, write_glb, write_mesh
from goc.geometry.surfaces import surface_cloud, vertex_normals
from goc.geometry.topology import is_watertight, signed_volume
from goc.scene import Mesh, World

_DESCRIPTION = """Close one partial scan: a point cloud or mesh of an object that was seen in part.

INPUT is .ply, .pcd, .glb, .obj, .xyz, .txt or .pts. Normals are estimated where a point cloud has none; a mesh must be
wound counter-clockwise seen from outside. Where the scan was seen from is found out if it was one place (from its file,
from the origin, or from how dense its points are), and space that was seen through stays empty; otherwise nothing is
known to be empty, and more is a guess. The output tells what was taken for granted, and what share is imagined. If you
have the views of a scan, use `goc carve`, which knows the rays of all of them.

examples:
  goc complete mug.ply --out mug_closed.ply
  goc complete chair.glb --out chair_closed.glb --cells 200
  goc complete scan.xyz --out scan.glb --up y
  goc complete kinect.ply --out box.ply --viewpoint 0 0 0
  goc complete tabletop.pcd --out can.ply --find-support
  goc complete merged.ply --out box.ply --viewpoint 0 0 0 --viewpoint 1 0 0.5 --support-plane 0 0 1 -0.7
  goc complete mug.ply --out mug_closed.ply --method osc --weights osc_m.safetensors"""

_SAMPLES = 100_000
"""Points sampled on a mesh that is given as a scan."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments of the command line."""

    source: Annotated[Path, tyro.conf.arg(metavar="INPUT"), tyro.conf.Positional]
    """The partial scan."""
    out: Annotated[Path, tyro.conf.arg(metavar="MESH")]
    """The closed mesh: .ply (vertex property `observed`: 1 measured, 0 filled in) or .glb (y up)."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace MESH if it is there."""
    scan: Annotated[ScanConfig, tyro.conf.arg(name=""), tyro.conf.UseAppendAction] = field(default_factory=ScanConfig)


def main(words: Sequence[str]) -> int:
    """Run `goc complete` with the words that follow it."""
    arguments = parse(Arguments, words, "goc complete", _DESCRIPTION)
    if arguments.out.suffix.lower() not in (".ply", ".glb"):
        raise ConfigError(f"--out {arguments.out}: goc writes .ply and .glb. Choose one of them.")
    if arguments.out.exists() and not arguments.overwrite:
        raise ConfigError(f"{arguments.out}: is there already. Pass --overwrite to replace it.")
    started = time.monotonic()
    done = _completed(arguments)
    _write(done, arguments)
    sys.stdout.write(_summary(done, arguments.out, time.monotonic() - started))
    return 0


def _completed(arguments: Arguments) -> ClosedScan:
    given = read_scan(arguments.source)
    if isinstance(given, Mesh):
        if is_watertight(given):
            raise ConfigError(f"{arguments.source}: is watertight already. There is nothing to complete.")
        given = surface_cloud(given, _SAMPLES)
    config = arguments.scan
    if config.up is None and config.support_plane is None and not config.find_support and _is_y_up(arguments.source):
        config = replace(config, up="y")
    with shown_progress() as notify:
        return complete_scan(given, config, notify)


def _is_y_up(path: Path) -> bool:
    return path.suffix.lower() in (".glb", ".obj")


def _write(done: ClosedScan, arguments: Arguments) -> None:
    if arguments.out.suffix.lower() == ".ply":
        write_mesh(arguments.out, done.mesh, done.observed)
        return
    world = World(up=done.up, floor=0.0, confidence=1.0, units_per_metre=1.0, metric=True)
    write_glb(arguments.out, done.mesh, vertex_normals(done.mesh), world.level_from_world, arguments.source.stem)


def _summary(done: ClosedScan, out: Path, seconds: float) -> str:
    sides = " x ".join(f"{side:.3g}" for side in np.ptp(done.mesh.vertices, axis=0))
    volume = f"volume {signed_volume(done.mesh):.3g} (units of the file)"
    lines = [
        f"closed in {duration(seconds)}: {len(done.mesh.faces):,} faces, {sides}, {volume}, "
        f"{done.imagined:.0%} of the surface imagined.",
        f"  taken for granted   {'; '.join(done.assumed)}",
        f"  filled in by        {done.method}",
        f"  look at             {out}",
    ]
    return "\n".join(lines) + "\n"
