"""One benchmark run: carve or fuse a capture, evaluate it, and write the result."""

import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from goc.bench.plan import TRANSFORMS, Method, Run
from goc.bench.result import Result
from goc.capture import load_capture
from goc.complete import CompleteConfig, close_objects, with_contacts
from goc.errors import BenchError
from goc.evaluation import Evaluation, evaluate
from goc.events import ignore
from goc.extract import ExtractConfig, WorldConfig, extract_objects, find_world, fuse_scene, views_noise
from goc.files import is_file, object_files, object_ids, read_json, write_json, write_meshes
from goc.files.layout import REPORT
from goc.report import read_report
from goc.runs import RunRecord, is_stopped_run

RESULT = "result.json"
_LOG = "carve.log"
_CARVED = "carved"


_CLOSED_BY: dict[Method, Literal["none", "hull", "lite"]] = {"fuse": "none", "fuse-hull": "hull", "fuse-lite": "lite"}


@dataclass(frozen=True, kw_only=True)
class _Told:
    """What a run tells of itself."""

    stages: dict[str, float]
    """Seconds a stage."""
    peak_memory_mb: float | None = None
    psnr_db: float | None = None
    """In held-out views, where there are splats."""


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
    source, made = capture / TRANSFORMS[run.views], own / _CARVED
    command = ["goc", "carve", str(source), "--out", str(made), *run.words]
    carves, resumes = run.method == "carve", is_stopped_run(made)
    started = time.perf_counter()
    if carves:
        told = _carve([*command[1:], "--resume" if resumes else "--overwrite"], own)
    else:
        told = _fuse(source, made, CompleteConfig(method=_CLOSED_BY[run.method]))
    seconds = time.perf_counter() - started
    scores = evaluate(made, truth, meshes="observed")
    closed = any(is_file(object_files(made, id).solid) for id in object_ids(made))
    result = Result(
        run=run.name,
        command=shlex.join(command) if carves else f"fused {source}",
        commit=source_commit(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=None if resumes else round(seconds, 1),
        stages=told.stages,
        peak_memory_mb=told.peak_memory_mb,
        objects=scores.counts.objects,
        found=scores.counts.found,
        values=flat_scores(scores) | {"psnr_db": told.psnr_db},
        completed=flat_scores(evaluate(made, truth, meshes="completed")) if closed else {},
    )
    write_json(own / RESULT, result)
    return result


def _carve(words: list[str], own: Path) -> _Told:
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
    report = read_report(own / _CARVED / REPORT)
    psnr = report.metrics.get("held_out_psnr_db")
    return _Told(stages=report.seconds, peak_memory_mb=report.peak_memory_mb, psnr_db=psnr)


def _fuse(source: Path, out: Path, completion: CompleteConfig) -> _Told:
    """Write the meshes that exact depth and ids give, laid out as `goc carve` does."""
    record = RunRecord(ignore)
    shutil.rmtree(out, ignore_errors=True)
    with record.stage("capture"):
        capture = load_capture(source)
    with record.stage("extract"):
        config, noise = ExtractConfig(), views_noise(capture)
        mesh = fuse_scene(capture, config, noise=noise)
        objects = extract_objects(capture, config, noise=noise)
        world = find_world(mesh, capture, WorldConfig())
    with record.stage("complete"):
        objects = close_objects(with_contacts(objects, mesh, world), completion)
    write_meshes(out, mesh, objects)
    return _Told(stages={stage: round(took, 2) for stage, took in record.seconds.items()})


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
