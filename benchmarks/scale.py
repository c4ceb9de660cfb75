"""Cost against views, pixels, splats and objects: `python benchmarks/scale.py [--docs FILE] [--thousand]`.

Each run is a short `goc carve` in a process of its own, on a room of boxes (benchmarks/boxes.py, kept in
build/benchmarks); one quantity grows at a time. `--thousand` adds 1,000 views of 640x480, for the memory they need.
"growth" is the power of the quantity that the cost follows from the smallest to the largest run: 1 = proportional.
Each result is kept as it comes; `--resume` takes those of a stopped benchmark.
"""

import argparse
import json
import math
import os
import shutil
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from boxes import BoxRoom, box_capture
from goc import _native
from goc.runs import this_machine
from plot import Chart, draw
from runs import Measured, reference_ms, run_apart

KEPT = Path(__file__).parent.parent / "build" / "benchmarks"
RESULTS = KEPT / "scale"
STEPS = 60
EXTRACTION = ("find surfaces", "fuse scene", "find objects", "fuse objects", "gather evidence")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run."""

    views: int = 60
    width: int = 400
    splats: int = 30_000
    objects: int = 8

    @property
    def room(self) -> BoxRoom:
        """The capture that it needs."""
        return BoxRoom(views=self.views, width=self.width, height=self.width * 3 // 4, objects=self.objects)


@dataclass(frozen=True, kw_only=True)
class Series:
    """Runs that differ in one quantity."""

    name: str
    cases: tuple[Case, ...]
    quantity: Callable[[Case], float]


SMALL = Case(width=160, splats=15_000)
SERIES = (
    Series(
        name="views",
        cases=tuple(replace(SMALL, views=n) for n in (50, 170, 500, 1000)),
        quantity=lambda case: case.views,
    ),
    Series(
        name="pixels a view",
        cases=tuple(Case(width=n) for n in (240, 400, 640)),
        quantity=lambda case: case.width * case.width * 3 / 4,
    ),
    Series(
        name="splats",
        cases=tuple(Case(splats=n) for n in (15_000, 30_000, 60_000, 120_000)),
        quantity=lambda case: case.splats,
    ),
    Series(
        name="objects",
        cases=tuple(Case(objects=n) for n in (2, 8, 32)),
        quantity=lambda case: case.objects,
    ),
)
THOUSAND = Case(views=1000, width=640, splats=80_000)


def measured(case: Case) -> Measured:
    """Make the capture if need be, and carve it; once for all series that have the case."""
    room = case.room
    known = RESULTS / f"{room.views}x{room.width}-{case.splats}-{room.objects}.json"
    if known.is_file():
        return Measured(**json.loads(known.read_text()))
    folder = KEPT / f"boxes-{room.views}x{room.width}-{room.objects}"
    box_capture(folder, room)
    started = time.monotonic()
    words = ("--iterations", str(STEPS), "--reconstruct.mcmc.max-splats", str(case.splats))
    run = run_apart(folder, words)
    print(f"{case}: {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
    known.parent.mkdir(parents=True, exist_ok=True)
    known.write_text(json.dumps(asdict(run)))
    return run


COLUMNS: dict[str, Callable[[Measured], float]] = {
    "ms a step": lambda run: run.step_ms,
    "seeds s": lambda run: run.of("seed"),
    "labels s": lambda run: run.of("label"),
    "extraction s": lambda run: run.of(*EXTRACTION),
    "completion s": lambda run: run.of("complete"),
    "all s": lambda run: run.total,
    "peak MB": lambda run: run.peak_mb,
}


def table(series: Series, runs: list[Measured]) -> str:
    """One row a run, and how each cost grows."""
    sizes = [series.quantity(case) for case in series.cases]
    lines = [f"| {series.name} | {' | '.join(COLUMNS)} |", "|" + "---|" * (1 + len(COLUMNS))]
    for size, run in zip(sizes, runs, strict=True):
        lines.append(f"| {size:,.0f} | " + " | ".join(_shown(value(run)) for value in COLUMNS.values()) + " |")
    span = math.log(sizes[-1] / sizes[0])
    powers = [math.log(value(runs[-1]) / value(runs[0])) / span for value in COLUMNS.values()]
    lines.append("| *growth* | " + " | ".join(f"{power:.2f}" for power in powers) + " |")
    return "\n".join(lines)


def _shown(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}"


def chart(series: Series, runs: list[Measured]) -> Chart:
    """The costs worth a line."""
    shown = ("ms a step", "extraction s", "all s")
    lines = {name: tuple(COLUMNS[name](run) for run in runs) for name in shown}
    return Chart(title=series.name, x=tuple(series.quantity(case) for case in series.cases), lines=lines)


def heading(reference: float) -> str:
    """Where and how this was measured."""
    machine = this_machine()
    base = Case()
    size = f"{base.width}x{base.width * 3 // 4}"
    return (
        f"{machine.cpu}, {machine.cores} cores ({machine.simd}), {machine.memory_gb:g} GB; "
        f"load {os.getloadavg()[0]:.1f}; 1024² float32 product on one thread: {reference:.1f} ms. {STEPS} steps a run. "
        f"Unless a table says otherwise, {base.views} views of {size}, {base.splats:,} splats, {base.objects} objects; "
        f"the table of views has {SMALL.width}x{SMALL.width * 3 // 4} and {SMALL.splats:,} splats."
    )


def thousand(run: Measured) -> str:
    """What the largest capture needs."""
    size = f"{THOUSAND.views:,} views of {THOUSAND.width}x{THOUSAND.width * 3 // 4}, {run.splats:,} splats"
    pieces = ", ".join(f"{name} {seconds:.0f} s" for name, seconds in run.seconds.items())
    return f"{size}: peak {run.peak_mb:,.0f} MB, {run.step_ms:.0f} ms a step, {run.total:.0f} s together ({pieces})."


def main() -> None:
    """Print tables, draw them, write them as JSON and as a page where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--docs", type=Path, help="Markdown page; the chart is put beside it")
    parser.add_argument("--thousand", action="store_true")
    parser.add_argument("--series", nargs="*", default=[series.name for series in SERIES], help="only these")
    parser.add_argument("--resume", action="store_true", help="keep the results of a benchmark that was stopped")
    given = parser.parse_args()
    if not given.resume:
        shutil.rmtree(RESULTS, ignore_errors=True)
    chosen = [series for series in SERIES if series.name in given.series]
    before = reference_ms()
    found = {series.name: [measured(case) for case in series.cases] for series in chosen}
    large = measured(THOUSAND) if given.thousand else None
    reference = statistics.mean((before, reference_ms()))
    parts = [heading(reference), *(table(series, found[series.name]) for series in chosen)]
    parts += [thousand(large)] if large else []
    text = "\n\n".join(parts)
    print(text)
    if given.json:
        runs = {name: [asdict(run) for run in runs] for name, runs in found.items()}
        cases = {series.name: [asdict(case) for case in series.cases] for series in chosen}
        document = {
            "reference_ms": reference,
            "steps": STEPS,
            "simd": _native.simd_level(),
            "cases": cases,
            "runs": runs,
        }
        given.json.write_text(json.dumps(document | {"thousand": large and asdict(large)}, indent=1))
    if given.docs:
        picture = given.docs.with_suffix(".png")
        draw([chart(series, found[series.name]) for series in chosen], picture)
        command = " ".join(["python", "benchmarks/scale.py", *sys.argv[1:]])
        page = f"# Cost against size\n\nWritten by `{command}`.\n\n{text}\n\n![costs over sizes]({picture.name})\n"
        given.docs.write_text(page)


if __name__ == "__main__":
    main()
