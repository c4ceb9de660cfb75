"""One run: carve or fuse, judge, keep the result."""

import shlex
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from goc.bench.plan import TRANSFORMS, Run
from goc.bench.result import Result
from goc.capture import load_capture
from goc.errors import BenchError
from goc.evaluation import Evaluation, evaluate
from goc.extract import ExtractConfig, extract_objects, fuse_scene
from goc.files import is_file, read_json, write_json, write_mesh
from goc.runs import is_stopped_run

RESULT = "result.json"
_LOG = "carve.log"
_CARVED = "carved"


class _Report(msgspec.Struct):
    """What is read of a run's report.json."""

    metrics: dict[str, float | None]
    peak_memory_mb: float


def kept_result(folder: Path, run: Run) -> Result | None:
    """The result of an earlier run of the same name; None where there is none."""
    path = folder / run.name / RESULT
    return read_json(path, Result) if is_file(path) else None


def measure(run: Run, capture: Path, truth: Path, folder: Path) -> Result:
    """Carry out a run and judge it; what it made stays in the run's folder.

    Args:
        run: what to do.
        capture: folder with the run's input.
        truth: folder with the room's ground truth.
        folder: of all runs; a stopped run in it is continued.

    Raises:
        BenchError: the command failed; its log says why.
    """
    own = folder / run.name
    own.mkdir(parents=True, exist_ok=True)
    source = capture / TRANSFORMS[run.views]
    command = ["goc", "carve", str(source), "--out", str(own / _CARVED), *run.words]
    resumes = is_stopped_run(own / _CARVED)
    started = time.perf_counter()
    if run.method == "carve":
        _carve([*command[1:], "--resume" if resumes else "--overwrite"], own)
    else:
        _fuse(source, own / _CARVED)
    seconds = time.perf_counter() - started
    report = read_json(own / _CARVED / "report.json", _Report) if run.method == "carve" else None
    scores = evaluate(own / _CARVED, truth, meshes="observed")
    closed = any((own / _CARVED).glob("objects/*/mesh.ply"))
    completed = flat_scores(evaluate(own / _CARVED, truth, meshes="completed")) if closed else {}
    values = flat_scores(scores)
    if report is not None:
        values["psnr_db"] = report.metrics.get("held_out_psnr_db")
    result = Result(
        run=run.name,
        command=shlex.join(command) if run.method == "carve" else f"fused {source}",
        commit=source_commit(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=None if resumes else round(seconds, 1),
        peak_memory_mb=None if report is None else report.peak_memory_mb,
        objects=scores.counts.objects,
        found=scores.counts.found,
        values=values,
        completed=completed,
    )
    write_json(own / RESULT, result)
    return result


def _carve(words: list[str], own: Path) -> None:
    """In a process of its own, so that time and memory are the command's."""
    with (own / _LOG).open("a", encoding="utf-8") as log:
        done = subprocess.run(
            [sys.executable, "-m", "goc.cli", *words], stdout=log, stderr=subprocess.STDOUT, check=False
        )
    if done.returncode:
        last = (own / _LOG).read_text(encoding="utf-8").strip().splitlines()[-1:]
        raise BenchError(
            f"{own.name}: goc carve ended with {done.returncode}: {' '.join(last)} (all of it: {own / _LOG})"
        )


def _fuse(source: Path, out: Path) -> None:
    capture = load_capture(source)
    write_mesh(out / "scene" / "mesh.ply", fuse_scene(capture, ExtractConfig()))
    for item in extract_objects(capture, ExtractConfig()):
        write_mesh(out / "objects" / str(item.id) / "observed.ply", item.mesh)


def flat_scores(scores: Evaluation) -> dict[str, float | None]:
    """Means over the objects, and the scene's, under one name each."""
    return scores.mean | {f"scene.{name}": value for name, value in (scores.scene or {}).items()}


def source_commit() -> str:
    """Commit of the source tree that runs, with + where files differ from it; empty outside of one."""
    here = Path(__file__).resolve().parent

    def git(*words: str) -> str:
        done = subprocess.run(["git", "-C", str(here), *words], capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        commit = git("rev-parse", "--short", "HEAD")
        tracked = git("ls-files", "--error-unmatch", str(Path(__file__).resolve()))
        changed = git("status", "--porcelain", "--untracked-files=no", ".")
    except OSError:  # no git
        return ""
    return commit + ("+" if changed else "") if tracked else ""
