"""`goc osc prepare`: converts a folder of meshes to signed distance grids, stored in shards."""

import csv
import multiprocessing
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
from jaxtyping import Int8

from goc import _native
from goc.errors import GocError, TrainError
from goc.events import Listener, Progress, ignore
from goc.files import MESH_SUFFIXES, is_file, read_any_mesh, read_json, write_json, write_tensors
from goc.settings import Positive, Range, Settings
from goc.training.library import MANIFEST, STEPS, Manifest, PreparedShape, SkippedMesh
from goc.training.mesh_to_shape import shape_from_mesh

_SHARD = 32
"""Shapes in a file, about 20 MB; after a stop, at most one file is made again."""
_TABLE = "objects.csv"


@dataclass(frozen=True, kw_only=True)
class PrepareConfig(Settings):
    """How meshes become training shapes."""

    cells: Annotated[int, Range(least=8, most=1024)] = 96
    """Voxels along the longest side."""
    seconds: Positive = 60.0
    """Longest time for one mesh, seconds; a mesh that takes longer is dropped."""
    workers: Annotated[int, Range(least=1, most=1024)] = 1
    """Meshes prepared at the same time, each in its own process."""


@dataclass(frozen=True, kw_only=True)
class MeshSource:
    """A mesh to prepare."""

    name: str
    path: Path
    split: Literal["train", "val"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Made:
    """A prepared shape that is not yet in a shard."""

    distance: Int8[np.ndarray, "x y z"]
    origin: tuple[float, float, float]
    voxel: float
    how: str


def prepare(meshes: Path, out: Path, config: PrepareConfig, notify: Listener = ignore) -> Manifest:
    """Convert every mesh below `meshes` to a signed distance grid in `out`, and continue an earlier run that stopped.

    A mesh that cannot be used does not stop the run: the manifest lists the dropped meshes with reasons.

    Args:
        meshes: folder; objects.csv in it (columns file, name, split) gives the split, else all are train.
        out: folder for shards and manifest.json.
        config: resolution and limits.
        notify: receives progress.

    Raises:
        TrainError: there are no meshes, or objects.csv is wrong.
    """
    sources = find_meshes(meshes)
    path = out / MANIFEST
    manifest = read_json(path, Manifest) if is_file(path) else Manifest()
    done = {shape.name for shape in manifest.kept} | {mesh.name for mesh in manifest.dropped}
    waiting = [source for source in sources if source.name not in done]
    pending: list[tuple[MeshSource, _Made, float]] = []
    finished = len(sources) - len(waiting)
    for source, made, seconds in _worked(waiting, config):
        if isinstance(made, str):
            manifest.dropped.append(SkippedMesh(name=source.name, why=made))
        else:
            pending.append((source, made, seconds))
        finished += 1
        if len(pending) == _SHARD or finished == len(sources):
            _write_shard(out, manifest, pending)
            pending = []
        figures = {"kept": float(len(manifest.kept) + len(pending)), "dropped": float(len(manifest.dropped))}
        notify(Progress(stage="prepare", done=finished, total=len(sources), figures=figures))
    return manifest


def find_meshes(folder: Path) -> list[MeshSource]:
    """List all meshes below a folder, or those of its objects.csv, in the order of their names.

    Raises:
        TrainError: there are none, or the table names a missing file or a split other than train and val.
    """
    table = folder / _TABLE
    if is_file(table):
        return _from_table(table)
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in MESH_SUFFIXES)
    if not paths:
        raise TrainError(f"{folder}: holds no meshes ({', '.join(MESH_SUFFIXES)}). Check the path.")
    return [
        MeshSource(name="/".join(path.relative_to(folder).with_suffix("").parts), path=path, split="train")
        for path in paths
    ]


def _from_table(table: Path) -> list[MeshSource]:
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = []
    for row in rows:
        if row.get("split") not in ("train", "val") or not row.get("file") or not row.get("name"):
            raise TrainError(f"{table}: needs the columns file, name and split (train or val); first bad row: {row}.")
        path = table.parent / row["file"]
        if not is_file(path):
            raise TrainError(f"{table}: names {row['file']}, which is not there. Copy it, or leave the row out.")
        found.append(MeshSource(name=row["name"], path=path, split=row["split"]))
    return sorted(found, key=lambda source: source.name)


def _worked(sources: list[MeshSource], config: PrepareConfig) -> Iterator[tuple[MeshSource, "_Made | str", float]]:
    """Yield results as they are finished: source, shape or the reason why there is none, and seconds."""
    context = multiprocessing.get_context("spawn")
    waiting, running = list(sources), []
    while waiting or running:
        while waiting and len(running) < config.workers:
            running.append(_Worker(context, config))
        for worker in list(running):
            if worker.source is None:
                if waiting:
                    worker.begin(waiting.pop(0))
                else:
                    worker.stop()
                    running.remove(worker)
                continue
            result = worker.result(config.seconds)
            if result is not None:
                yield result
                if not worker.alive:
                    running.remove(worker)
        time.sleep(0.01)


class _Worker:
    """A process that prepares one mesh after the other, and is killed if a mesh takes too long."""

    def __init__(self, context: multiprocessing.context.SpawnContext, config: PrepareConfig) -> None:
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, config.cells), daemon=True)
        self._process.start()
        theirs.close()
        self.source: MeshSource | None = None
        self.alive = True
        self._since = 0.0

    def begin(self, source: MeshSource) -> None:
        """Send a mesh to the process."""
        self.source, self._since = source, time.monotonic()
        self._pipe.send(source)

    def result(self, limit: float) -> tuple[MeshSource, "_Made | str", float] | None:
        """Return source, shape or the reason why there is none, and seconds; None while it is not finished."""
        source, seconds = self.source, time.monotonic() - self._since
        assert source is not None
        if self._pipe.poll():
            try:
                made = self._pipe.recv()
            except EOFError:
                made = f"its process died ({self._process.exitcode})"
                self.stop()
        elif seconds > limit + (0 if self._process.is_alive() else -limit):
            made = f"took longer than {limit:g} s" if self._process.is_alive() else "its process died"
            self.stop()
        else:
            return None
        self.source = None
        return source, made, seconds

    def stop(self) -> None:
        """End the process."""
        self.alive = False
        self._pipe.close()
        self._process.kill()
        self._process.join()


def _work(pipe: Connection, cells: int) -> None:
    """Main loop of a worker process: receive meshes, and send back shapes or the reasons why there are none."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)
    _native.set_thread_count(1)
    while True:
        try:
            source = pipe.recv()
        except EOFError:
            return
        try:
            made = _made(source, cells)
        except (GocError, ValueError, MemoryError) as error:
            made = str(error)
        try:
            pipe.send(made)
        except OSError:  # the parent closed the pipe
            return


def _made(source: MeshSource, cells: int) -> _Made:
    solid, how = shape_from_mesh(read_any_mesh(source.path, weld=True), cells)
    steps = np.clip(np.rint(solid.distance * (STEPS / solid.voxel)), -127, 127).astype(np.int8)
    return _Made(distance=steps, origin=tuple(float(v) for v in solid.origin), voxel=solid.voxel, how=how)


def _write_shard(out: Path, manifest: Manifest, pending: list[tuple[MeshSource, _Made, float]]) -> None:
    """Write the shard, then the manifest that lists it, so that a stop in between loses only the shard."""
    if pending:
        number = len({shape.shard for shape in manifest.kept})
        shard = f"shapes-{number:04}.safetensors"
        write_tensors(
            out / shard, {f"{source.name}/distance": torch.from_numpy(made.distance) for source, made, _ in pending}
        )
        for source, made, seconds in pending:
            manifest.kept.append(
                PreparedShape(
                    name=source.name,
                    split=source.split,
                    shard=shard,
                    how=made.how,
                    origin=made.origin,
                    voxel=made.voxel,
                    seconds=round(seconds, 2),
                )
            )
    write_json(out / MANIFEST, manifest)
