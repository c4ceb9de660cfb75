"""What every test may use."""

import os
from pathlib import Path

import pytest
import torch

torch.set_num_threads(1)  # its threads spin, and fight the native pool on a busy machine


@pytest.fixture(scope="session")
def data_root() -> Path:
    """../shared/data: benchmark rooms and real captures, which are not part of the project."""
    root = Path(os.environ.get("GOC_DATA", Path(__file__).parents[2] / "shared/data"))
    if not (root / "bench").is_dir():
        pytest.skip(f"{root} holds no data (set GOC_DATA)")
    return root
