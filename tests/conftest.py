"""Fixtures of the whole suite."""

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # `from oracles import …`


@pytest.fixture(scope="session")
def data_root() -> Path:
    """../shared/data (or $GOC_DATA); tests that need it skip where it is absent."""
    root = Path(os.environ.get("GOC_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not root.is_dir():
        pytest.skip(f"needs the benchmark data, absent at {root} (set GOC_DATA)")
    return root
