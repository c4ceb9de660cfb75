"""Every example runs as its docstring says, and tells what it promises."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
TOLD = {
    "01_carve": ["6 objects: 1, 2, 3, 4, 5, 6", "overview.png"],
    "02_read_a_scene": ["splats, 12 cameras", "object 6, ", "above the floor"],
    "03_complete_a_scan": ["watertight: True", "volume 3."],
    "04_rasterise": ["depth in the middle: 2.000 m"],
    "05_evaluate": ["f_score_0.05", "of 6 objects found"],
}
"""Words that each example prints."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder for all: later examples read what the first has made."""
    return tmp_path_factory.mktemp("example")


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", sorted(path.stem for path in EXAMPLES.glob("*.py")))
def test_an_example_runs(name, folder):
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}  # the goc that is tested
    words = [sys.executable, "-W", "error", str(EXAMPLES / f"{name}.py"), str(folder)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    for told in TOLD[name]:
        assert told in done.stdout, done.stdout
