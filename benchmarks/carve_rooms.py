"""Carve the benchmark rooms and score what comes out: `python benchmarks/carve_rooms.py --data ../shared/data/bench`.

Runs `goc carve` on each room with all 170 views and with the 50 of transforms_sparse.json, each in a process of its
own (so that time and memory are the command's), and prints docs/benchmarks.md's table. A finished run is not repeated:
delete its folder under --out to measure again.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

from goc.evaluation.rooms import score_room
from goc.files import read_mesh
from goc.scene import Mesh

ROOMS = ("living", "study", "kitchen")
CAPTURES = {"170": "transforms.json", "50": "transforms_sparse.json"}


def carve(source: Path, out: Path, extra: list[str]) -> None:
    """Run the command, and keep its wall clock beside its output."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "goc.cli", "carve", str(source), "--out", str(out), *extra], check=True)
    (out / "wall_seconds.txt").write_text(f"{time.perf_counter() - start:.1f}")


def objects_of(out: Path) -> dict[int, Mesh]:
    """The observed mesh of each object, by id."""
    return {int(path.parent.name): read_mesh(path) for path in sorted(out.glob("objects/*/observed.ply"))}


def row(name: str, room: Path, out: Path) -> str:
    """One line of the table."""
    report = json.loads((out / "report.json").read_text())
    scores = score_room(room, objects_of(out), read_mesh(out / "scene" / "mesh.ply"))
    mean, scene = scores.mean(), scores.scene
    assert scene is not None
    wall = float((out / "wall_seconds.txt").read_text())
    cells = [
        name,
        f"{report['metrics']['held_out_psnr_db']:.1f}",
        f"{len(scores.objects) - len(scores.missing)} of {len(scores.objects)}",
        *(f"{mean[key]:.4f}" for key in ("accuracy", "completion", "chamfer")),
        *(f"{mean[key]:.3f}" for key in ("f_score_0.05", "f_score_0.01", "normal_consistency")),
        *(f"{mean[key]:.4f}" for key in ("completion_seen", "completion_unseen")),
        f"{scene.f_score[0.05]:.3f}",
        f"{wall / 60:.1f}",
        f"{report['peak_memory_mb'] / 1024:.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Carve, score, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/bench"))
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS), choices=ROOMS)
    parser.add_argument("--views", nargs="+", default=list(CAPTURES), choices=list(CAPTURES))
    parser.add_argument("carve", nargs="*", help="passed on to goc carve, after --")
    arguments = parser.parse_args()
    rows = []
    for room in arguments.rooms:
        for views in arguments.views:
            out = arguments.out / f"{room}-{views}"
            if not (out / "wall_seconds.txt").exists():
                carve(arguments.data / room / CAPTURES[views], out, ["--overwrite", *arguments.carve])
            rows.append(row(f"{room}, {views}", arguments.data / room, out))
    print(f"\n{platform.machine()}, {os.cpu_count()} cores; goc carve {' '.join(arguments.carve)}\n")
    print(
        "| room, views | PSNR dB | objects | Acc | Comp | CD | F@5cm | F@1cm | NC | Comp seen | Comp unseen "
        "| scene F@5cm | min | GB |"
    )
    print("|" + "---|" * 14)
    print("\n".join(rows))


if __name__ == "__main__":
    main()
