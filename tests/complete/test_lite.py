from pathlib import Path

import numpy as np
import pytest
import torch

from goc import complete
from goc.complete import (
    LiteConfig,
    OscConfig,
    bounding_cube,
    build,
    cell_centres,
    load_network,
    partial_object,
    save_network,
    weights,
)
from goc.complete.lite import FeatureGrids
from goc.errors import CompleteError, FileError
from goc.files import write_tensors
from goc.scene import EvidenceGrid

TINY = LiteConfig(cells=16, fine=8, middle=16, width=24, blocks=1, heads=2, hidden=16)


def partial():
    random = np.random.default_rng(0)
    points = random.normal(size=(50, 3))
    evidence = EvidenceGrid(
        origin=np.full(3, -1.0),
        voxel=0.2,
        state=random.integers(0, 3, (12, 12, 12)).astype(np.uint8),
        sdf=random.normal(0, 0.1, (12, 12, 12)).astype(np.float32),
    )
    return partial_object(points, None, evidence, bounding_cube(points))


def test_the_network_that_ships_fits_into_the_package():
    count = sum(parameter.numel() for parameter in build(LiteConfig()).parameters())
    assert 4 * count < 30e6


def test_features_are_exact_at_cell_centres_and_linear_between():
    volume = torch.randn(1, 3, 8, 8, 8)
    features = FeatureGrids(volumes=(volume,))
    centres = torch.from_numpy(cell_centres(8))
    at = features.at(centres.reshape(1, -1, 3))
    torch.testing.assert_close(at[0].T.reshape(3, 8, 8, 8), volume[0], atol=1e-5, rtol=1e-5)
    between = features.at((0.5 * (centres[2, 3, 4] + centres[3, 3, 4]))[None, None])
    torch.testing.assert_close(between[0, 0], 0.5 * (volume[0, :, 2, 3, 4] + volume[0, :, 3, 3, 4]))


def test_a_field_gives_what_the_network_gives_in_any_chunks():
    network, seen = build(TINY).eval(), partial()
    field = network.complete(seen)
    points = torch.rand(70, 3) * 2 - 1
    whole = field.logits(points)
    assert whole.shape == (70,)
    pieces = torch.cat([field.logits(part) for part in points.split(9)])
    torch.testing.assert_close(whole, pieces)
    assert field.logits(points[:0]).shape == (0,)


@pytest.mark.parametrize(
    "config", [TINY, OscConfig(encoder=1, decoder=1, width=16, heads=2, tokens=8, latent=4, points=32)]
)
def test_a_network_comes_back_from_disk(tmp_path, config):
    network, path = build(config, seed=3).eval(), tmp_path / "weights.safetensors"
    save_network(path, network, {"steps": "7"})
    back = load_network(path)
    assert back.config == config
    points = torch.rand(20, 3)
    torch.testing.assert_close(back.complete(partial()).logits(points), network.complete(partial()).logits(points))
    save_network(path, network, half=True)
    torch.testing.assert_close(
        load_network(path).complete(partial()).logits(points),
        network.complete(partial()).logits(points),
        atol=2e-2,
        rtol=1e-2,
    )


def test_a_package_without_weights_says_so(tmp_path, monkeypatch):
    missing = tmp_path / "weights" / "osc_lite.safetensors"
    monkeypatch.setattr(weights, "SHIPPED", missing)
    with pytest.raises(CompleteError, match=r"osc_lite\.safetensors: goc was packaged without weights. Pass weights"):
        load_network(missing)
    missing.parent.mkdir()
    save_network(missing, build(TINY))
    assert load_network(missing).config == TINY
    missing.write_bytes(b"not tensors at all")
    with pytest.raises(FileError, match=r"osc_lite\.safetensors"):
        load_network(missing)


def test_the_weights_that_ship_are_in_the_package_and_fit():
    assert weights.SHIPPED.parent.parent == Path(complete.__file__).parent
    if not weights.SHIPPED.is_file():
        pytest.skip("goc ships no weights yet")
    assert weights.SHIPPED.stat().st_size <= 30e6
    assert load_network().config == LiteConfig(hints=True)


def test_what_is_no_network_is_refused(tmp_path):
    with pytest.raises(FileError, match="not found"):
        load_network(tmp_path / "none.safetensors")
    write_tensors(tmp_path / "other.safetensors", {"a": torch.zeros(2)}, {})
    with pytest.raises(CompleteError, match="no weights of a completion network"):
        load_network(tmp_path / "other.safetensors")
    network = build(TINY)
    tensors = {name: value for name, value in network.state_dict().items() if not name.startswith("stem")}
    write_tensors(tmp_path / "part.safetensors", tensors, {"kind": "lite", "config": "{}"})
    with pytest.raises(CompleteError, match="Train them again"):
        load_network(tmp_path / "part.safetensors")
