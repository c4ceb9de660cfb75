"""Training batches, made ahead by worker processes and delivered in the order of the steps."""

import signal
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from goc import _native
from goc.training.library import open_library
from goc.training.masking import MaskConfig
from goc.training.procedural import random_shape
from goc.training.reuse import split_pool
from goc.training.samples import LoaderConfig, TrainingBatch, make_batch
from goc.training.watertight_shape import WatertightShape

_EVER = 10**9


@dataclass(frozen=True, kw_only=True)
class BatchRecipe:
    """Everything that determines a batch, besides its number."""

    loader: LoaderConfig
    masking: MaskConfig
    cells: int
    """Cells along each side of the evidence grid that the network takes."""
    hints: bool
    """Whether it takes hints beside it."""
    data: Path | None
    """Prepared shapes; None: procedural ones alone."""
    seed: int

    def draw(self, random: np.random.Generator) -> WatertightShape:
        """Draw a prepared shape, or a procedural one."""
        if self.data is not None and random.random() < self.loader.prepared_share:
            library = open_library(self.data, "train")
            return library[int(random.integers(len(library)))]
        return random_shape(random, self.loader.resolution)

    def pool(self, number: int) -> TrainingBatch:
        """Masked objects for `reuse`² batches; pool `number` is the same in every run."""
        times = self.loader.reuse
        loader = replace(self.loader, batch=self.loader.batch * times, queries=self.loader.queries * times)
        return make_batch(self.draw, loader, self.masking, self.cells, (self.seed, number), self.hints)

    def batches(self, pool: TrainingBatch, number: int) -> Iterator[TrainingBatch]:
        """The batches of pool `number`."""
        return split_pool(pool, self.loader.reuse, (self.seed, number, 1))


class _Pools(Dataset[TrainingBatch]):
    """Pools by their number, as a dataset for torch's DataLoader."""

    def __init__(self, recipe: BatchRecipe) -> None:
        self.recipe = recipe

    def __getitem__(self, number: int) -> TrainingBatch:
        return self.recipe.pool(number)


def batches(recipe: BatchRecipe, first: int, workers: int, rank: int = 0, world: int = 1) -> Iterator[TrainingBatch]:
    """The endless stream of batches of one of `world` processes, from step `first` on.

    Args:
        recipe: what they are made of; the same step has the same batch in every run.
        first: steps that were taken already.
        workers: processes that make pools ahead; 0 makes them here.
        rank: which of the processes: each has pools of its own.
        world: how many there are.
    """
    each = recipe.loader.reuse**2
    numbers = range(first // each * world + rank, _EVER, world)
    skipped = first % each
    for number, pool in zip(numbers, _pools(recipe, numbers, workers), strict=True):
        yield from islice(recipe.batches(pool, number), skipped, None)
        skipped = 0


def _pools(recipe: BatchRecipe, numbers: range, workers: int) -> Iterator[TrainingBatch]:
    if workers == 0:
        yield from (recipe.pool(number) for number in numbers)
        return
    loader = DataLoader(
        _Pools(recipe),
        batch_size=None,
        sampler=numbers,
        num_workers=workers,
        prefetch_factor=2,
        multiprocessing_context="spawn",  # the kernels' threads do not survive a fork
        worker_init_fn=_init_worker,
    )
    yield from loader


def _init_worker(worker: int) -> None:
    """Set up a worker: one thread, as others use the other cores, and no Ctrl-C, as the trainer ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)
    _native.set_thread_count(1)
