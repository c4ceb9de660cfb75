import itertools
from dataclasses import replace

import msgspec
import numpy as np
import pytest
import torch

from goc.complete import SIZES, LiteConfig, Osc, build, load_network, save_network
from goc.errors import ConfigError, TrainError
from goc.events import Progress, Warned
from goc.files import read_tensors
from goc.training import train as training
from goc.training.config import OptimiserConfig, TrainConfig
from goc.training.loader import BatchRecipe, batches
from goc.training.losses import LossConfig, hard_iou
from goc.training.masking import MaskConfig
from goc.training.primitives import Box, Cylinder
from goc.training.samples import LoaderConfig, make_batch
from goc.training.state import initial_state
from goc.training.train import has_bf16, rate_factor, step, train
from goc.training.watertight_shape import CsgPart, shape_from_parts

STOOL = shape_from_parts(
    [
        CsgPart(body=Cylinder(0.5, 0.2), at=(0, 0, 0.9)),
        *(CsgPart(body=Box((0.12, 0.12, 0.9)), at=(x, y, 0.45)) for x in (-0.3, 0.3) for y in (-0.3, 0.3)),
    ],
    48,
)
SMALL = LiteConfig(cells=16, fine=16, middle=16, width=32, blocks=1, heads=2, hidden=32)
TINY = TrainConfig(
    steps=4,
    validate_every=3,
    loader=LoaderConfig(batch=1, masks=1, queries=128, resolution=32, workers=0),
    masking=MaskConfig(size_px=32),
    optimiser=OptimiserConfig(bf16=False),
)


@pytest.fixture
def tiny(monkeypatch):
    """Trainings of a network that takes no time."""
    monkeypatch.setattr(TrainConfig, "network", lambda self: SMALL)
    monkeypatch.setattr(training, "_VALIDATION_SHAPES", 2)


@pytest.mark.parametrize(("can", "told"), [("AVX2", False), ("DEFAULT", False), ("AVX512", True)])
def test_only_cpus_that_have_it_multiply_in_bfloat16(monkeypatch, can, told):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: can)
    assert has_bf16(torch.device("cpu")) is told
    assert has_bf16(torch.device("cuda"))


def test_a_training_begins_from_given_weights(tiny, tmp_path):
    first = build(SMALL, 7)
    save_network(tmp_path / "first.safetensors", first)
    slow = replace(TINY.optimiser, rate=1e-9)
    begun = train(tmp_path / "run", replace(TINY, steps=1, init=tmp_path / "first.safetensors", optimiser=slow))
    found = load_network(begun).state_dict()
    for name, value in first.state_dict().items():
        torch.testing.assert_close(found[name], value, atol=1e-3, rtol=1e-3)  # float16


def train_on(network, batch, steps, rate):
    config = TrainConfig(steps=steps, optimiser=OptimiserConfig(rate=rate, bf16=False, warmup=0.05))
    state = initial_state(network, rate, 0.0)
    return [step(state, batch, config)["loss"] for _ in range(steps)], state


def test_osc_s_learns():
    """The paper's smallest size, whole but for fewer tokens: a few steps on tiny data, and the loss falls."""
    network = Osc(replace(SIZES["S"], tokens=32, points=128))
    batch = make_batch(
        lambda _: STOOL,
        LoaderConfig(batch=1, masks=1, queries=256),
        MaskConfig(noise=0.0, size_px=32, points=128),
        cells=8,
        seed=(0,),
    )
    losses, _ = train_on(network, batch, steps=5, rate=3e-5)
    assert losses[-1] < 0.95 * losses[0]


def test_lite_overfits_one_shape():
    network = build(SMALL)
    loader, masking = LoaderConfig(batch=2, masks=2, queries=1024), MaskConfig(noise=0.0, size_px=48)
    batch = make_batch(lambda _: STOOL, loader, masking, cells=16, seed=(1,))
    losses, _ = train_on(network, batch, steps=120, rate=1e-2)
    assert losses[-1] < 0.4 * losses[0]
    logits, _ = network(batch.seen, batch.queries)
    assert hard_iou(logits, batch.distance, 0.5).mean() > 0.75


def test_a_stopped_training_goes_on_as_if_it_had_not_stopped(tmp_path, tiny):
    train(tmp_path / "whole", TINY)
    train(tmp_path / "parts", replace(TINY, steps=2))
    weights = train(tmp_path / "parts", TINY)
    whole, parts = (read_tensors(tmp_path / name / training.STATE)[0] for name in ("whole", "parts"))
    # the rate depends on the share of the budget, which differs in the first two steps
    assert whole.keys() == parts.keys()
    assert load_network(weights).config == SMALL
    same = replace(TINY, seed=1)
    train(tmp_path / "same", same)
    with pytest.raises(TrainError, match="other settings"):
        train(tmp_path / "same", TINY)


def test_resuming_is_bit_equal(tmp_path, tiny, monkeypatch):
    def stop_after(count):
        made = training.batches
        monkeypatch.setattr(training, "batches", lambda *given: itertools.islice(made(*given), count))

    train(tmp_path / "whole", TINY)
    with monkeypatch.context():
        stop_after(2)
        train(tmp_path / "parts", TINY)
    monkeypatch.undo()
    monkeypatch.setattr(TrainConfig, "network", lambda self: SMALL)
    monkeypatch.setattr(training, "_VALIDATION_SHAPES", 2)
    train(tmp_path / "parts", TINY)
    whole, parts = (read_tensors(tmp_path / name / training.STATE)[0] for name in ("whole", "parts"))
    for name, value in whole.items():
        assert torch.equal(value, parts[name]), name


def test_a_training_tells_how_it_goes(tmp_path, tiny):
    heard = []
    train(tmp_path, TINY, heard.append)
    done = [event.done for event in heard if isinstance(event, Progress) and event.stage == "train"]
    assert done == [1, 2, 3, 4]
    lines = [msgspec.json.decode(line) for line in (tmp_path / "curves.jsonl").read_bytes().splitlines()]
    assert any("validation/iou" in line for line in lines) and any("train/loss" in line for line in lines)
    assert (tmp_path / "completions.png").is_file()
    assert all(isinstance(event, Progress | Warned) for event in heard)


def test_a_loss_that_is_not_finite_stops_the_training():
    network = build(SMALL)
    batch = make_batch(lambda _: STOOL, LoaderConfig(batch=1, queries=64), MaskConfig(size_px=32), cells=16, seed=(1,))
    torch.nn.init.constant_(network.stem.weight, float("nan"))
    with pytest.raises(TrainError, match="not finite at step 0"):
        train_on(network, batch, steps=1, rate=1e-3)


def test_the_rate_rises_and_falls_to_nothing():
    shares = np.linspace(0, 1, 101)
    factors = [rate_factor(float(share), 0.1) for share in shares]
    assert factors[0] == 0 and factors[-1] == pytest.approx(0)
    assert max(factors) == pytest.approx(1) and int(np.argmax(factors)) == 10
    assert (np.diff(factors)[11:] < 0).all()


def first_batches(recipe, first, count, **place):
    return list(itertools.islice(batches(recipe, first, **place), count))


@pytest.mark.parametrize("reuse", [1, 2])
def test_workers_give_the_batches_in_order(reuse):
    loader = replace(TINY.loader, reuse=reuse)
    recipe = BatchRecipe(loader=loader, masking=TINY.masking, cells=16, hints=False, data=None, seed=0)
    here = first_batches(recipe, 3, 3, workers=0)
    there = first_batches(recipe, 3, 3, workers=1)
    assert all(torch.equal(a.queries, b.queries) for a, b in zip(here, there, strict=True))
    whole = first_batches(recipe, 0, 6, workers=0)
    assert all(torch.equal(a.queries, b.queries) for a, b in zip(here, whole[3:], strict=True))


def test_processes_have_masks_of_their_own():
    recipe = BatchRecipe(
        loader=replace(TINY.loader, reuse=2), masking=TINY.masking, cells=16, hints=False, data=None, seed=0
    )
    mine, theirs = (first_batches(recipe, 0, 8, workers=0, rank=rank, world=2) for rank in (0, 1))
    evidence = {float(batch.seen.evidence.double().square().sum()) for batch in mine}
    assert evidence.isdisjoint(float(batch.seen.evidence.double().square().sum()) for batch in theirs)


def test_budgets_that_mean_nothing_are_refused():
    with pytest.raises(ConfigError, match="needs 1 or more"):
        TrainConfig(steps=0)
    with pytest.raises(ConfigError, match="needs more than 0"):
        TrainConfig(minutes=0.0)
    assert LossConfig().threshold == 0.3
