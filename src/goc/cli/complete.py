"""`goc complete`: one partial scan in, a closed mesh out."""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float64

from goc.cli.arguments import parse
from goc.cli.progress import duration, shown_progress
from goc.complete import ClosedScan, ScanConfig, complete_scan
from goc.errors import ConfigError, FileError
from goc.files import read_scan, write_glb, write_mesh
from goc.geometry.surfaces import surface_cloud, vertex_normals
from goc.geometry.topology import is_watertight, signed_volume
from goc.geometry.winding import consistently_wound
from goc.scene import Mesh, PointCloud, World

_DESCRIPTION = """Close one partial scan: a point cloud or mesh of an object that was seen in part.

INPUT is .ply, .glb, .gltf, .obj, .stl, .off, .pcd, .las, .laz, .e57, or text (.xyz, .txt, .pts, .asc, .csv). Normals
are estimated where a point cloud has none; a mesh must be wound counter-clockwise seen from outside. Where the scan was
seen from is found out if it was one place (from its file, from the origin, or from how dense its points are), and space
that was seen through stays empty; otherwise nothing is known to be empty, and more is a guess. The output tells what
was taken for granted, what share is imagined, and how far to trust it. If you have the views of a scan, use
`goc carve`, which knows the rays of all of them.

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
    given = read_scan(arguments.source)
    cloud, remarks = _cloud(arguments.source, given.surface)
    with shown_progress() as notify:
        done = complete_scan(cloud, _config(arguments, given.offset), notify)
    _write(done, arguments, given.offset)
    done = replace(done, assumed=(*given.remarks, *remarks, *done.assumed))
    sys.stdout.write(_summary(done, arguments.out, time.monotonic() - started))
    return 0


def _cloud(source: Path, surface: Mesh | PointCloud) -> tuple[PointCloud, tuple[str, ...]]:
    """Points of a scan, and what was done to have them; faces of a mesh are first wound like their neighbours."""
    if isinstance(surface, PointCloud):
        return surface, ()
    surface, turned = consistently_wound(surface)
    if is_watertight(surface):
        raise ConfigError(f"{source}: is watertight already. There is nothing to complete.")
    words = f"{turned:,} of its {len(surface.faces):,} faces were wound against their neighbours: turned round"
    try:
        return surface_cloud(surface, _SAMPLES), (words,) if turned else ()
    except ValueError as error:
        raise FileError(f"{source}: none of its {len(surface.faces):,} faces has an area. Repair the mesh.") from error


def _config(arguments: Arguments, offset: Float64[np.ndarray, "3"]) -> ScanConfig:
    """The settings, places and planes moved to where the scan was moved to."""
    config = arguments.scan
    if config.up is None and config.support_plane is None and not config.find_support and _is_y_up(arguments.source):
        config = replace(config, up="y")
    if offset.any():
        config = replace(config, viewpoint=tuple(tuple((np.array(eye) - offset).tolist()) for eye in config.viewpoint))
        if config.support_plane is not None:
            *normal, constant = config.support_plane
            config = replace(config, support_plane=(*normal, float(constant + np.array(normal) @ offset)))
    return config


def _is_y_up(path: Path) -> bool:
    return path.suffix.lower() in (".glb", ".gltf", ".obj")


def _write(done: ClosedScan, arguments: Arguments, offset: Float64[np.ndarray, "3"]) -> None:
    if arguments.out.suffix.lower() == ".ply":
        write_mesh(arguments.out, done.mesh, done.observed, offset)
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
