"""What every test may use."""

import os
from pathlib import Path

import hypothesis
import pytest
import torch

torch.set_num_threads(1)  # its threads spin, and fight the native pool on a busy machine
hypothesis.settings.register_profile("goc", deadline=None)  # times belong into benchmarks/
hypothesis.settings.load_profile("goc")


@pytest.fixture(scope="session")
def data_root() -> Path:
    """../shared/data: benchmark rooms and real captures, which are not part of the project."""
    root = Path(os.environ.get("GOC_DATA", Path(__file__).parents[2] / "shared/data"))
    if not (root / "bench").is_dir():
        pytest.skip(f"{root} holds no data (set GOC_DATA)")
    return root
