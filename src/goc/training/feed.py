"""Batches made beside the training: by worker processes, in the order of the steps."""

import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from goc import _native
from goc.training.library import open_library
from goc.training.masking import MaskConfig
from goc.training.samples import FeedConfig, TrainingBatch, make_batch
from goc.training.shapes import random_solid
from goc.training.solids import Solid


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """All that a batch depends on, besides its number."""

    feed: FeedConfig
    masking: MaskConfig
    cells: int
    """Of the evidence grid that the network takes."""
    data: Path | None
    """Prepared shapes; None: procedural ones alone."""
    seed: int

    def draw(self, random: np.random.Generator) -> Solid:
        """A prepared or a procedural shape."""
        if self.data is not None and random.random() < self.feed.real:
            library = open_library(self.data, "train")
            return library[int(random.integers(len(library)))]
        return random_solid(random, self.feed.resolution)

    def batch(self, number: int) -> TrainingBatch:
        """Batch `number`; the same in every run."""
        return make_batch(self.draw, self.feed, self.masking, self.cells, (self.seed, number))


class _Batches(Dataset[TrainingBatch]):
    """Numbered batches, for torch's workers."""

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe

    def __getitem__(self, number: int) -> TrainingBatch:
        return self.recipe.batch(number)


def batches(recipe: Recipe, numbers: range, workers: int) -> Iterator[TrainingBatch]:
    """The batches of these numbers in this order, made ahead by `workers` processes; 0 makes them here."""
    if workers == 0:
        yield from (recipe.batch(number) for number in numbers)
        return
    loader = DataLoader(
        _Batches(recipe),
        batch_size=None,
        sampler=numbers,
        num_workers=workers,
        prefetch_factor=3,
        multiprocessing_context="spawn",  # the kernels' threads do not survive a fork
        worker_init_fn=_alone,
    )
    yield from loader


def _alone(worker: int) -> None:
    """A worker uses one core: there are others. Ctrl-C is for the trainer, which ends its workers itself."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)
    _native.set_thread_count(1)
