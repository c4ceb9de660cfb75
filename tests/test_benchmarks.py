"""Benchmark scripts follow the names that they import: nothing else notices when one of those changes."""

import os
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "benchmarks"


def test_every_script_imports():
    names = sorted(path.stem for path in FOLDER.glob("*.py"))
    paths = [*sys.path, str(FOLDER)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    words = [sys.executable, "-c", f"import {', '.join(names)}"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
