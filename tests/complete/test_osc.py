import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from goc.complete import (
    SIZES,
    Osc,
    OscConfig,
    PartialBatch,
    QueryGrid,
    Refinement,
    bounding_cube,
    build,
    decode,
    partial_object,
)
from goc.complete.layers import FOURIER, CrossBlock, fourier_features
from goc.complete.sampling import farthest_points
from goc.scene import EvidenceGrid
from oracles.decoding import decode_densely

TINY = OscConfig(encoder=2, decoder=2, width=32, heads=4, tokens=16, latent=4, points=64)


def seen(points):
    return PartialBatch(points=points, normals=torch.zeros_like(points), evidence=torch.zeros(len(points), 4, 1, 1, 1))


@pytest.mark.parametrize(("size", "millions"), [("S", 63), ("M", 101), ("L", 139), ("L164", 164)])
def test_sizes_have_the_parameters_of_table_5(size, millions):
    with torch.device("meta"):
        count = sum(parameter.numel() for parameter in Osc(SIZES[size]).parameters())
    assert count / 1e6 == pytest.approx(millions, rel=0.01)


def test_fourier_features_are_the_position_and_its_octaves():
    features = fourier_features(torch.tensor([[0.25, 0.0, -1.0]]))
    assert features.shape == (1, FOURIER) == (1, 51)
    assert features[0, :3].tolist() == [0.25, 0.0, -1.0]
    assert features[0, 3:6].tolist() == pytest.approx([math.sin(math.pi / 4), 1.0, 0.0], abs=1e-5)


def test_farthest_points_matches_the_definition():
    torch.manual_seed(0)
    points = torch.randn(2, 40, 3)
    rows = farthest_points(points, 12)
    for cloud, taken in zip(points, rows.tolist(), strict=True):
        expected = [0]
        while len(expected) < 12:
            gaps = [min(float((p - cloud[i]).norm()) for i in expected) for p in cloud]
            expected.append(gaps.index(max(gaps)))
        assert taken == expected


def test_farthest_points_repeats_where_points_are_few():
    rows = farthest_points(torch.zeros(1, 3, 3), 5)
    assert rows.shape == (1, 5)
    assert int(rows.max()) < 3


def test_the_latent_is_a_token_a_sampled_point():
    latent = build(TINY).encode(torch.randn(2, 64, 3))
    assert latent.mean.shape == latent.log_variance.shape == (2, 16, 4)


def test_kept_keys_and_values_change_nothing():
    network, queries = build(TINY).eval(), torch.rand(1, 30, 3) * 2 - 1
    latent = network.encode(torch.randn(1, 64, 3)).mean
    memory = network.remember(latent)
    whole = network.decode(queries, memory)
    tokens = network.from_latent(latent)
    for block in network.decoder_self:
        tokens = block(tokens)
    found = network.embed(fourier_features(queries))
    for block in network.decoder_cross:
        found = block(found, block.keys_values(tokens))
    torch.testing.assert_close(whole, network.to_logit(found)[..., 0])
    halves = [network.decode(part, memory) for part in queries.split(15, 1)]
    torch.testing.assert_close(torch.cat(halves, 1), whole, atol=1e-5, rtol=1e-4)


def test_the_order_of_the_points_after_the_first_does_not_matter():
    """Cross-attention is over a set; FPS starts at the first point."""
    network, points = build(TINY).eval(), torch.randn(1, 64, 3)
    order = torch.cat([torch.zeros(1, dtype=torch.int64), 1 + torch.randperm(63)])
    queries = torch.rand(1, 10, 3)
    one, other = (network.decode(queries, network.remember(network.encode(p).mean)) for p in (points, points[:, order]))
    torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-4)


def test_the_divergence_of_a_standard_latent_is_zero():
    network = build(TINY)
    for head in (network.to_mean, network.to_log_variance):
        torch.nn.init.zeros_(head.weight)
        torch.nn.init.zeros_(head.bias)
    _, divergence = network(seen(torch.randn(1, 64, 3)), torch.rand(1, 8, 3))
    assert divergence.item() == pytest.approx(0.0, abs=1e-6)


def test_the_divergence_sums_over_a_token_and_means_over_tokens():
    network = build(replace(TINY, latent=8))
    torch.nn.init.zeros_(network.to_log_variance.weight)
    torch.nn.init.zeros_(network.to_log_variance.bias)
    torch.nn.init.zeros_(network.to_mean.weight)
    torch.nn.init.constant_(network.to_mean.bias, 2.0)
    _, divergence = network(seen(torch.randn(1, 64, 3)), torch.rand(1, 8, 3))
    assert divergence.item() == pytest.approx(0.5 * 8 * 4.0, rel=1e-5)


def test_a_field_makes_keys_and_values_once_however_often_it_is_asked(monkeypatch):
    made = []
    remembered = CrossBlock.keys_values
    monkeypatch.setattr(
        CrossBlock, "keys_values", lambda block, tokens: made.append(block) or remembered(block, tokens)
    )
    network, points = build(TINY).eval(), np.random.default_rng(0).normal(size=(80, 3))
    evidence = EvidenceGrid(
        origin=np.zeros(3), voxel=1.0, state=np.zeros((2, 2, 2), np.uint8), sdf=np.zeros((2, 2, 2), np.float32)
    )
    field = replace(network.complete(partial_object(points, None, evidence, bounding_cube(points))), chunk=7)
    assert len(made) == TINY.encoder + TINY.decoder
    queries = QueryGrid(origin=np.full(3, -0.9), voxel=0.1, shape=(19, 19, 19))
    fast, dense = decode(field, queries, Refinement(cells=4)), decode_densely(field, queries)
    assert len(made) == TINY.encoder + TINY.decoder
    assert fast[::4, ::4, ::4] == pytest.approx(dense[::4, ::4, ::4], abs=1e-5)
