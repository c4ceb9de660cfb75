"""Coarse to fine against the dense twin, on fields whose shape is known."""

from dataclasses import dataclass, field

import numpy as np
import pytest
import torch

from goc.complete import QueryGrid, Refinement, decode, signed_distance
from goc.errors import CompleteError
from oracles.decoding import decode_densely


@dataclass
class Balls:
    """Log-odds of a union of balls, steep as a trained field; counts what it is asked."""

    balls: tuple[tuple[float, float, float, float], ...]
    asked: list[int] = field(default_factory=list)

    def logits(self, points):
        self.asked.append(len(points))
        off = [torch.linalg.norm(points - torch.tensor(ball[:3]), dim=-1) - ball[3] for ball in self.balls]
        return -40.0 * torch.stack(off).min(0).values


def query_grid(*shape):
    voxel = 1.9 / (max(shape) - 1)
    return QueryGrid(origin=np.full(3, -0.95), voxel=voxel, shape=shape)


def test_the_surface_is_that_of_the_dense_field_at_a_part_of_the_cost():
    ball, at = Balls(((0.0, 0.1, -0.2, 0.45),)), query_grid(97, 96, 90)
    fast, dense = decode(ball, at, Refinement(cells=24)), decode_densely(ball, at)
    assert np.array_equal(fast < 0, dense < 0)
    near = np.abs(dense) < 2.0
    assert np.array_equal(fast[near], dense[near])
    assert sum(ball.asked[:-1]) < 0.3 * ball.asked[-1]


@pytest.mark.parametrize("shape", [(33, 17, 9), (40, 23, 31), (8, 8, 8), (70, 1, 3)])
def test_odd_shapes_and_grids_too_small_to_refine(shape):
    ball, at = Balls(((-0.6, -0.6, -0.6, 0.3),)), query_grid(*shape)
    fast, dense = decode(ball, at, Refinement(cells=8)), decode_densely(ball, at)
    assert fast.shape == shape
    assert np.array_equal(fast < 0, dense < 0)


def test_a_ball_between_the_first_nodes_is_found_where_points_were_seen():
    """Smaller than a coarse cell, and too steep to be guessed from its corners."""
    at = query_grid(97, 97, 97)
    small = Balls(((0.03, 0.03, 0.03, 0.025), (-0.5, -0.5, -0.5, 0.2)))
    dense = decode_densely(small, at)
    seen = np.zeros(at.shape, bool)
    seen[49:51, 49:51, 49:51] = True
    missed = decode(small, at, Refinement(cells=12, band=0.5))
    found = decode(small, at, Refinement(cells=12, band=0.5), forced=seen)
    assert (dense[45:55, 45:55, 45:55] >= 0).sum() > 1
    assert not (missed[45:55, 45:55, 45:55] >= 0).any()
    assert np.array_equal(found >= 0, dense >= 0)


def test_only_what_is_wanted_is_asked():
    ball, at = Balls(((0.0, 0.0, 0.0, 0.5),)), query_grid(97, 97, 97)
    wanted = np.zeros(at.shape, bool)
    wanted[:30] = True
    fast = decode(ball, at, Refinement(cells=24), wanted=wanted)
    cost = sum(ball.asked)
    ball.asked.clear()
    dense = decode_densely(ball, at)
    assert np.array_equal(fast[:30] < 0, dense[:30] < 0)
    ball.asked.clear()
    decode(ball, at, Refinement(cells=24))
    assert cost < 0.6 * sum(ball.asked)


def test_a_grid_finer_than_the_model_is_interpolated():
    ball, at = Balls(((0.0, 0.1, -0.2, 0.45),)), query_grid(97, 97, 97)
    coarse = decode(ball, at, Refinement(cells=24, enough=48))
    asked = sum(ball.asked)
    dense = decode_densely(ball, at)
    near = np.abs(dense) < 2.0
    np.testing.assert_allclose(coarse[near], dense[near], atol=0.1)
    assert np.array_equal(coarse[::2, ::2, ::2][near[::2, ::2, ::2]], dense[::2, ::2, ::2][near[::2, ::2, ::2]])
    assert asked <= 49**3


def test_nothing_is_asked_outside_the_cube():
    class Inside(Balls):
        def logits(self, points):
            assert points.abs().max() <= 1.0
            return super().logits(points)

    at = QueryGrid(origin=np.full(3, -1.5), voxel=0.1, shape=(31, 31, 31))
    values = decode(Inside(((0.0, 0.0, 0.0, 5.0),)), at, Refinement(cells=8))
    assert (values[:5] < 0).all() and values[15, 15, 15] > 0


@pytest.mark.parametrize(("steepness", "threshold"), [(40.0, 0.5), (3.0, 0.5), (40.0, 0.3)])
def test_log_odds_become_distances_whatever_their_steepness(steepness, threshold):
    at = query_grid(49, 49, 49)
    axes = [at.origin[0] + at.voxel * np.arange(49)] * 3
    radius = np.linalg.norm(np.stack(np.meshgrid(*axes, indexing="ij"), -1), axis=-1)
    logits = (steepness * (0.6 - radius)).astype(np.float32)
    level = np.log(threshold / (1 - threshold))
    truth = (radius - 0.6 + level / steepness) / at.voxel
    near = np.abs(truth) < 2
    distance = signed_distance(logits, threshold)
    np.testing.assert_allclose(distance[near], truth[near], atol=0.05)
    assert (np.sign(distance[~near]) == np.sign(truth[~near])).all()
    assert np.abs(distance).max() <= 3.0


def test_a_field_that_answers_nonsense_is_refused():
    class Broken:
        def logits(self, points):
            return torch.full((len(points),), torch.nan)

    with pytest.raises(CompleteError, match="The model answers 729 of 729 queries with numbers that are not finite"):
        decode(Broken(), query_grid(9, 9, 9), Refinement(cells=8))
