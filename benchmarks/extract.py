"""Time extraction and completion of one room: `python benchmarks/extract.py --data ROOMS [--json FILE]`.

Exact depth and ids of all 170 views of 384×384; completion by the hull. Absolute times drift from machine to machine:
the last column is a ratio to the 1024² float32 product that benchmarks/engine.py measures, of the same run.
"""

import argparse
import json
import resource
import statistics
import time
from pathlib import Path

import torch

from goc import _native
from goc.capture import load_capture
from goc.complete import CompleteConfig, close_objects
from goc.events import Event, Progress
from goc.extract import ExtractConfig, extract_objects, fuse_scene


class Clock:
    """Seconds a stage: each ends with its last progress, what follows is work between stages."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()
        self._stage = ""

    def lap(self, stage: str) -> None:
        """What passed since the last lap was `stage`."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last, self._stage = now, ""

    def hear(self, event: Event) -> None:
        """A listener."""
        if isinstance(event, Progress):
            changed = self._stage not in ("", event.stage)
            self.lap(f"after {self._stage!r}" if changed else event.stage)
            self._stage = event.stage


def product_seconds() -> float:
    """The reference: median of 15 products of 1024² matrices on one thread."""
    matrix, threads, times = torch.rand(1024, 1024), torch.get_num_threads(), []
    torch.set_num_threads(1)
    for _ in range(17):
        start = time.perf_counter()
        _ = matrix @ matrix
        times.append(time.perf_counter() - start)
    torch.set_num_threads(threads)
    return statistics.median(times[2:])


def stages(room: Path) -> dict[str, float]:
    """Seconds of everything between the files of a room and its closed objects."""
    clock = Clock()
    views = load_capture(room / "transforms.json")
    for index in range(len(views)):  # files into the page cache: not what is measured
        views[index]
    clock.lap("reading files once")
    objects = extract_objects(views, ExtractConfig(), clock.hear)
    clock.lap("evidence")
    fuse_scene(views, ExtractConfig(), clock.hear)
    clock.lap("scene surface")
    close_objects(objects, CompleteConfig(method="hull"))
    clock.lap("complete")
    return clock.seconds


def main() -> None:
    """Print a table; write it as JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of rooms")
    parser.add_argument("--room", default="living")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    reference = product_seconds()
    seconds = stages(arguments.data / arguments.room)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    extraction = sum(seconds.values()) - seconds["reading files once"] - seconds["complete"]
    rows = seconds | {"extraction, all": extraction}
    print(
        f"{_native.simd_level()}, {_native.thread_count()} threads, product {1e3 * reference:.1f} ms, {memory:.1f} GB\n"
    )
    print("| stage | s | / product |")
    print("|---|---|---|")
    for stage, spent in rows.items():
        print(f"| {stage} | {spent:.2f} | {spent / reference:.0f} |")
    if arguments.json:
        document = {"simd": _native.simd_level(), "threads": _native.thread_count(), "reference_s": reference}
        arguments.json.write_text(json.dumps(document | {"peak_gb": memory, "seconds": rows}, indent=1))


if __name__ == "__main__":
    main()
