"""Training on two processes, as torchrun starts them: one network, the mean of both gradients."""

import os
import socket
import subprocess
import sys

import torch

from goc.complete import LiteConfig, PartialBatch, build
from goc.files import read_tensors
from goc.training.config import OptimiserConfig, TrainConfig
from goc.training.loader import batches
from goc.training.masking import MaskConfig
from goc.training.samples import LoaderConfig, TrainingBatch
from goc.training.state import initial_state
from goc.training.train import STATE, recipe, step

SMALL = LiteConfig(cells=16, fine=16, middle=16, width=32, blocks=1, heads=2, hidden=32)
CONFIG = TrainConfig(
    steps=1,
    loader=LoaderConfig(batch=1, masks=1, reuse=1, queries=128, resolution=32, workers=0),
    masking=MaskConfig(size_px=32),
    optimiser=OptimiserConfig(bf16=False),
)
PROGRAM = """
import sys, torch
from pathlib import Path
from goc.complete import LiteConfig
from goc.training import train as training
from goc.training.config import OptimiserConfig, TrainConfig
from goc.training.cuts import CutConfig
from goc.training.masking import MaskConfig
from goc.training.samples import LoaderConfig
from goc.training.losses import LossConfig

torch.set_num_threads(1)
small, config = (eval(text) for text in sys.argv[2:4])
TrainConfig.network = lambda self: small
training._VALIDATION_SHAPES = 1
training.train(Path(sys.argv[1]), config)
"""


def together(batches_):
    """Batches of several processes as one."""
    return TrainingBatch(
        seen=PartialBatch(
            **{
                name: torch.cat([getattr(one.seen, name) for one in batches_])
                for name in ("points", "normals", "evidence")
            }
        ),
        queries=torch.cat([one.queries for one in batches_]),
        distance=torch.cat([one.distance for one in batches_]),
    )


def test_two_processes_step_as_one_with_both_their_batches(tmp_path, monkeypatch):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    given = os.environ | {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port)}
    words = [sys.executable, "-c", PROGRAM, str(tmp_path), repr(SMALL), repr(CONFIG)]
    running = [
        subprocess.Popen(words, env=given | {"RANK": str(rank), "LOCAL_RANK": str(rank)}, stderr=subprocess.PIPE)
        for rank in range(2)
    ]
    told = [process.communicate(timeout=200)[1].decode() for process in running]
    assert [process.returncode for process in running] == [0, 0], told
    monkeypatch.setattr(TrainConfig, "network", lambda self: SMALL)
    network = build(SMALL, CONFIG.seed)
    state = initial_state(network, CONFIG.optimiser.rate, CONFIG.optimiser.decay)
    both = together([next(batches(recipe(CONFIG), 0, 0, rank, 2)) for rank in range(2)])
    step(state, both, CONFIG)
    trained = read_tensors(tmp_path / STATE)[0]
    moments = {name.removeprefix("exp_avg/"): value for name, value in trained.items() if name.startswith("exp_avg/")}
    assert moments.keys() == dict(network.named_parameters()).keys()
    for name, parameter in network.named_parameters():
        expected = state.optimiser.state[parameter]["exp_avg"]
        torch.testing.assert_close(moments[name], expected, atol=1e-6, rtol=1e-3)
