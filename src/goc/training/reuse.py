"""Uses each mask several times: a pool of masked objects is split into batches, in another pose each time.

To make a mask takes as long as several training steps. Under the eight symmetries that gravity leaves (quarter turns,
each mirrored or not) a masked object becomes another plausible one; each use also has query points of its own.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import torch

from goc.complete import PartialBatch
from goc.complete.symmetry import POSES, posed_points, posed_volume
from goc.training.samples import TrainingBatch


def split_pool(pool: TrainingBatch, reuse: int, seed: Sequence[int]) -> Iterator[TrainingBatch]:
    """`reuse`² batches from a pool: each mask in `reuse` of them, never twice in the same pose, all its queries once.

    Args:
        pool: of b·reuse objects with q·reuse queries each; batches have b objects and q queries.
        reuse: rounds in which the pool is gone through, up to 8, and batches a round.
        seed: of the order and the poses; the same seed deals the same batches.
    """
    random = np.random.default_rng(list(seed))
    objects = len(pool.queries)
    poses = np.stack([random.permutation(POSES) for _ in range(objects)])
    for turn in range(reuse):
        for rows in np.split(random.permutation(objects), reuse):
            taken = [posed(pool, int(row), int(poses[row, turn]), slice(turn, None, reuse)) for row in rows]
            yield TrainingBatch(
                seen=PartialBatch(
                    points=torch.stack([one.seen.points[0] for one in taken]),
                    normals=torch.stack([one.seen.normals[0] for one in taken]),
                    evidence=torch.stack([one.seen.evidence[0] for one in taken]),
                ),
                queries=torch.stack([one.queries[0] for one in taken]),
                distance=torch.stack([one.distance[0] for one in taken]),
            )


def posed(pool: TrainingBatch, row: int, pose: int, asked: slice) -> TrainingBatch:
    """One object of a pool in one of the POSES, with some of its queries."""
    seen = pool.seen
    return TrainingBatch(
        seen=PartialBatch(
            points=posed_points(seen.points[row], pose)[None],
            normals=posed_points(seen.normals[row], pose)[None],
            evidence=posed_volume(seen.evidence[row], pose)[None],
        ),
        queries=posed_points(pool.queries[row, asked], pose)[None],
        distance=pool.distance[row, asked][None],
    )
