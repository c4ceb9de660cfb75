import numpy as np
import pytest
import torch

from goc.complete import PartialBatch, cell_centres
from goc.complete.symmetry import POSES
from goc.errors import ConfigError
from goc.training.reuse import posed, split_pool
from goc.training.samples import LoaderConfig, TrainingBatch

CELLS = 8


def field(points):
    """Any function of place without a symmetry."""
    x, y, z = np.moveaxis(np.asarray(points), -1, 0)
    return torch.from_numpy(np.asarray(x + 2 * y + 3 * z + x * y * y, np.float32))


def pool(objects=4, queries=8, seed=0):
    """Objects whose evidence and answers are the same function of place, each with a number of its own added."""
    random = np.random.default_rng(seed)
    points = random.uniform(-1, 1, (objects, queries, 3)).astype(np.float32)
    numbers = torch.arange(objects, dtype=torch.float32) * 100
    evidence = field(cell_centres(CELLS)).expand(objects, 1, CELLS, CELLS, CELLS) + numbers[:, None, None, None, None]
    return TrainingBatch(
        seen=PartialBatch(points=torch.from_numpy(points), normals=torch.from_numpy(points), evidence=evidence),
        queries=torch.from_numpy(points),
        distance=field(points) + numbers[:, None],
    )


def unposed(points, pose):
    """The inverse of a pose, by its definition."""
    angle = -(pose % 4) * np.pi / 2
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    back = points @ turn.T
    return back * [-1, 1, 1] if pose >= 4 else back


@pytest.mark.parametrize("pose", range(POSES))
def test_evidence_points_and_queries_turn_together(pose):
    whole = pool(objects=1)
    one = posed(whole, 0, pose, slice(None))
    np.testing.assert_allclose(one.seen.evidence[0, 0], field(unposed(cell_centres(CELLS), pose)), atol=1e-5)
    np.testing.assert_allclose(one.distance[0], field(unposed(one.queries[0].numpy(), pose)), atol=1e-5)
    assert torch.equal(one.seen.points, one.queries) and torch.equal(one.seen.normals, one.queries)


def test_every_mask_is_used_alike_and_every_query_once():
    whole, reuse = pool(objects=6, queries=9), 3
    dealt = list(split_pool(whole, reuse, (1,)))
    assert len(dealt) == reuse**2 and all(batch.queries.shape == (2, 3, 3) for batch in dealt)
    answers = torch.cat([batch.distance.ravel() for batch in dealt])
    assert torch.equal(answers.sort().values, whole.distance.ravel().sort().values)
    numbers = [int(round(float(n) / 100)) for batch in dealt for n in batch.seen.evidence.mean((1, 2, 3, 4))]
    assert sorted(numbers) == sorted(list(range(6)) * reuse)
    rounds = [set(numbers[i : i + 6]) for i in range(0, 18, 6)]
    assert all(seen == set(range(6)) for seen in rounds)


def test_no_mask_comes_twice_in_one_pose():
    whole = pool(objects=8, queries=8)
    shown = [tuple(e.ravel().tolist()) for batch in split_pool(whole, 8, (2,)) for e in batch.seen.evidence]
    assert len(set(shown)) == len(shown) == 64


def test_the_same_seed_deals_the_same():
    one, same, other = (next(split_pool(pool(), 2, seed)) for seed in ((3,), (3,), (4,)))
    assert torch.equal(one.queries, same.queries) and not torch.equal(one.queries, other.queries)


@pytest.mark.parametrize("reuse", [0, 9])
def test_more_uses_than_poses_are_refused(reuse):
    with pytest.raises(ConfigError, match=f"LoaderConfig.reuse is {reuse}: needs 1 to 8"):
        LoaderConfig(reuse=reuse)
