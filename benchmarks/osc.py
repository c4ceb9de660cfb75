"""Time completion and its training: `python benchmarks/osc.py [--sizes lite S] [--json FILE]`.

One half-seen ball on a grid of 128 voxels along its longest side, from evidence to closed mesh, with random weights:
a random field is unsure everywhere, so this is the worst case; `--weights FILE` completes with trained ones beside it.
Queries a level stand beside those of a dense decode. Absolute times drift from machine to machine: the last column is
a ratio to a 1024² float32 matrix product on as many threads, measured in the same run, both in CPU time.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from goc import _native
from goc.complete import (
    SIZES,
    Completer,
    LiteConfig,
    Measured,
    Network,
    OccupancyField,
    PartialObject,
    build,
    compose,
    load_network,
    model_fill,
)
from goc.geometry.isosurface import grid_surface
from goc.geometry.surfaces import vertex_normals
from goc.scene import Evidence, EvidenceGrid, FlaggedMesh, Mesh
from goc.training.config import TrainConfig
from goc.training.loader import BatchRecipe
from goc.training.samples import LoaderConfig, TrainingBatch
from goc.training.state import initial_state
from goc.training.train import recipe, step

CELLS, RADIUS, BAND = 128, 0.8, 3.0


@dataclass
class Counted:
    """A network that also says how many queries it is asked, call by call; one call a level."""

    network: Network
    calls: list[int] = field(default_factory=list)

    def complete(self, partial: PartialObject) -> "CountedField":
        """The network's field."""
        return CountedField(self.network.complete(partial), self.calls)


@dataclass
class CountedField:
    """A field that counts."""

    inner: OccupancyField
    calls: list[int]

    def logits(self, points: Tensor) -> Tensor:
        """The field's answer."""
        self.calls.append(len(points))
        return self.inner.logits(points)


def half_seen_ball() -> Measured:
    """Seen from above by parallel rays: a band on its upper half, empty above and beside it, unknown below."""
    voxel = 2.0 / CELLS
    axis = voxel * (np.arange(CELLS) + 0.5) - 1.0
    at = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    distance = np.linalg.norm(at, axis=-1) - RADIUS
    upper, beside = at[..., 2] > 0, np.linalg.norm(at[..., :2], axis=-1) > RADIUS
    surface = upper & (np.abs(distance) < BAND * voxel)
    passed = beside | (upper & (distance > 0))
    state = np.where(surface, Evidence.SURFACE, np.where(passed, Evidence.EMPTY, Evidence.UNKNOWN))
    vertices, faces = grid_surface(distance.astype(np.float32), np.full(3, axis[0]), voxel)
    used, place = np.unique(faces[(vertices[faces][..., 2] > 0).all(axis=1)], return_inverse=True)
    return Measured(
        mesh=Mesh(vertices=vertices[used], faces=place.reshape(-1, 3).astype(np.int32)),
        evidence=EvidenceGrid(
            origin=np.full(3, axis[0]),
            voxel=voxel,
            state=state.astype(np.uint8),
            sdf=np.where(surface, distance, 0).astype(np.float32),
        ),
    )


@dataclass(frozen=True, kw_only=True)
class Took:
    """Medians over repeats."""

    wall: float
    """Seconds."""
    cpu: float
    """Seconds of all threads together: says more than the wall's where other work runs beside."""


def timed(action: Callable[[], object], repeats: int) -> Took:
    """Time a call after one warm-up call."""
    wall, cpu = [], []
    for turn in range(repeats + 1):
        start, busy = time.perf_counter(), time.process_time()
        action()
        if turn:
            wall.append(time.perf_counter() - start)
            cpu.append(time.process_time() - busy)
    return Took(wall=statistics.median(wall), cpu=statistics.median(cpu))


def completed(found: Measured, network: Completer | None) -> FlaggedMesh:
    """From evidence to closed mesh: with a network, or the evidence hull."""
    if network is None:
        return compose(found, None)
    return compose(found, model_fill(network, found, vertex_normals(found.mesh), threshold=0.5, coarse_cells=64))


def completion_row(name: str, network: Network | None, repeats: int) -> dict[str, object]:
    """Time of one completion, and the queries of each level."""
    found = half_seen_ball()
    calls: list[int] = []
    if network is not None:
        completed(found, Counted(network, calls))
    return {
        "what": f"complete, {name}",
        "took": timed(lambda: completed(found, network), repeats),
        "queries": calls,
    }


def training_rows(name: str, network: Network, repeats: int) -> list[dict[str, object]]:
    """Time of one training step, and of making its batch; the paper's sizes with one object of 2,048 queries."""
    small = name != "lite"
    loader = LoaderConfig(batch=1, masks=1, reuse=1, queries=2048) if small else LoaderConfig()
    config = TrainConfig(size=name, steps=100, loader=loader)
    made = recipe(config)
    dealt = _batch(made)
    state = initial_state(network, config.optimiser.rate, config.optimiser.decay)
    stepped = timed(lambda: step(network, state, dealt, config), repeats)
    each = loader.reuse**2
    pool = timed(lambda: made.pool(1), 1)
    pooled = Took(wall=pool.wall / each, cpu=pool.cpu / each)
    shape = f"{loader.batch} objects x {loader.queries:,} queries"
    return [
        {"what": f"training step, {name}, {shape}", "took": stepped, "queries": []},
        {"what": f"its batch, one of {each} of a pool" if each > 1 else "its batch", "took": pooled, "queries": []},
    ]


def _batch(made: BatchRecipe) -> TrainingBatch:
    return next(made.batches(made.pool(0), 0))


def table(rows: list[dict[str, object]], product: Took) -> str:
    """The rows as Markdown."""
    dense = (CELLS + 4) ** 3
    lines = ["| what | s | CPU s | queries by level | share of dense | CPU / product |", "|---|---|---|---|---|---|"]
    for row in rows:
        calls, took = row["queries"], row["took"]
        asked = " + ".join(f"{count:,}" for count in calls) or "-"
        share = f"{sum(calls) / dense:.1%}" if calls else "-"
        lines.append(
            f"| {row['what']} | {took.wall:.2f} | {took.cpu:.2f} | {asked} | {share} | {took.cpu / product.cpu:,.0f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Print a table; write it as JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", nargs="+", default=["lite", "S"], choices=["lite", *SIZES])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--no-training", action="store_true", help="time completion alone")
    parser.add_argument("--weights", type=Path, help="complete with these as well: a trained field has less surface")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    matrix = torch.rand(1024, 1024)
    product = timed(lambda: matrix @ matrix, 15)
    rows = [completion_row("hull", None, arguments.repeats)]
    for size in arguments.sizes:
        network = build(LiteConfig() if size == "lite" else SIZES[size]).eval()
        repeats = arguments.repeats if size == "lite" else 1
        rows.append(completion_row(size, network, repeats))
        if not arguments.no_training:
            rows += training_rows(size, network, repeats)
    if arguments.weights:
        rows.append(completion_row(arguments.weights.name, load_network(arguments.weights), arguments.repeats))
    print(
        f"{_native.simd_level()}, {torch.get_num_threads()} threads, {CELLS} voxels along the longest side, "
        f"1024² float32 product: {1e3 * product.wall:.1f} ms, {1e3 * product.cpu:.1f} ms of CPU\n"
    )
    print(table(rows, product))
    if arguments.json:
        document = {"simd": _native.simd_level(), "threads": torch.get_num_threads(), "product": asdict(product)}
        rows = [row | {"took": asdict(row["took"])} for row in rows]
        arguments.json.write_text(json.dumps(document | {"rows": rows}, indent=1))


if __name__ == "__main__":
    main()
