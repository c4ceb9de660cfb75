"""One `goc carve` in a process of its own, timed by piece: what benchmarks/scale.py counts.

Seconds a stage of a whole run are in its report.json, and `goc bench` prints them; here pieces of a stage are told
apart, and steps are timed, by listening to the progress that goc reports.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

from engine import median_ms
from goc.cli.carve import arguments_of
from goc.events import Event, Progress
from goc.pipeline import carve
from goc.runs import peak_memory_mb


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What a run took."""

    seconds: dict[str, float]
    """By piece of work, in order: from the last event of the piece before it to its own last event."""
    step_ms: float
    """Mean of the optimisation steps but the first five."""
    peak_mb: float
    """Most memory the process ever held, 10⁶ bytes, Python and libraries included."""
    splats: int
    objects: int

    @property
    def total(self) -> float:
        """Seconds of the run, without the start of Python."""
        return sum(self.seconds.values())

    def of(self, *pieces: str) -> float:
        """Seconds of these pieces together."""
        return sum(self.seconds.get(piece, 0.0) for piece in pieces)


def reference_ms() -> float:
    """A 1024² float32 product on one thread, as benchmarks/engine.py has it: what machines and hours differ by."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    matrix = torch.rand(1024, 1024)
    found = median_ms(lambda: matrix @ matrix)
    torch.set_num_threads(threads)
    return found


def run_apart(capture: Path, words: Sequence[str]) -> Measured:
    """Carve in a child process; `words` are options of goc carve."""
    command = [sys.executable, __file__, str(capture), *words]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}: stopped with exit code {done.returncode}")
    return Measured(**json.loads(done.stdout))


def _measured(capture: Path, words: Sequence[str]) -> Measured:
    seconds: dict[str, float] = {}
    steps: list[float] = []
    last = time.perf_counter()

    def listen(event: Event) -> None:
        nonlocal last
        if isinstance(event, Progress):
            now = time.perf_counter()
            stage = "seed" if event.stage == "reconstruct" and event.done == 1 else event.stage
            seconds[stage] = seconds.get(stage, 0.0) + now - last
            last = now
            if event.stage == "reconstruct":
                steps.append(now)

    with tempfile.TemporaryDirectory() as folder:
        config = arguments_of([str(capture), "--out", folder, *words]).config()
        scene = carve(capture, Path(folder) / "out", config, listen)
        seconds["write"] = time.perf_counter() - last
    gaps = [1e3 * (b - a) for a, b in zip(steps[5:], steps[6:], strict=False)]
    return Measured(
        seconds=seconds,
        step_ms=statistics.mean(gaps),
        peak_mb=peak_memory_mb(),
        splats=len(scene.splats),
        objects=len(scene.objects),
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("capture", type=Path)
    given, options = parser.parse_known_args()
    json.dump(asdict(_measured(given.capture, options)), sys.stdout)
