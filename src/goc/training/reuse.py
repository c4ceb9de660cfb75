"""Masks used more than once: a pool is dealt into many batches, turned and mirrored differently each time.

A mask costs several training steps to make. Gravity leaves eight symmetries (quarter turns, each mirrored or not) under
which a masked object is another masked object; each use also asks at points of its own.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from goc.complete import PartialBatch
from goc.training.samples import TrainingBatch

SYMMETRIES = 8
"""Quarter turns about z, after a mirror in x from the fifth on."""


def deal(pool: TrainingBatch, reuse: int, seed: Sequence[int]) -> Iterator[TrainingBatch]:
    """`reuse`² batches from a pool: each mask in `reuse` of them, never twice in the same pose, all its queries once.

    Args:
        pool: of b·reuse objects with q·reuse queries each; batches have b objects and q queries.
        reuse: rounds in which the pool is gone through, up to 8, and batches a round.
        seed: of the order and the poses; the same seed deals the same batches.
    """
    random = np.random.default_rng(list(seed))
    objects = len(pool.queries)
    poses = np.stack([random.permutation(SYMMETRIES) for _ in range(objects)])
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
    """One object of a pool under one of the SYMMETRIES, with some of its queries."""
    evidence = pool.seen.evidence[row]
    if pose >= 4:
        evidence = evidence.flip(1)
    return TrainingBatch(
        seen=PartialBatch(
            points=_turned(pool.seen.points[row], pose)[None],
            normals=_turned(pool.seen.normals[row], pose)[None],
            evidence=torch.rot90(evidence, pose % 4, (1, 2))[None],
        ),
        queries=_turned(pool.queries[row, asked], pose)[None],
        distance=pool.distance[row, asked][None],
    )


def _turned(vectors: Float[Tensor, "p 3"], pose: int) -> Float[Tensor, "p 3"]:
    """Mirrored in x where the pose asks for it, then turned about z: (x, y) → (−y, x) a quarter."""
    x, y, z = vectors.unbind(-1)
    if pose >= 4:
        x = -x
    for _ in range(pose % 4):
        x, y = -y, x
    return torch.stack([x, y, z], -1)
