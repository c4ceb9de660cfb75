"""The commands of the guide to captures, run on a small room: what they write is read."""

import re
import shlex
from pathlib import Path

import pytest

from goc.capture import load_capture
from goc.cli import main

GUIDE = Path(__file__).parents[2] / "docs" / "guide" / "captures.md"
BLOCKS = re.findall(r"```sh\n(.*?)```", GUIDE.read_text(), re.DOTALL)
COMMANDS = [line for block in BLOCKS for line in block.splitlines()]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_every_command_of_the_guide_does_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    carved = 0
    for command in COMMANDS:
        program, verb, *words = shlex.split(command)
        assert program == "goc"
        if verb == "carve":  # minutes: that its capture is read is enough here
            assert len(load_capture(Path(words[0]))) >= 8
            carved += 1
            continue
        assert main([verb, *words]) == 0, command
    assert carved >= 4 and "The room is as-colmap" in capsys.readouterr().out
