"""The commands of the guide to captures, run on a small room: what they write is read."""

import os
import re
import shlex
import shutil
from pathlib import Path

import pytest

from goc.capture import load_capture
from goc.cli import main

GUIDES = sorted((Path(__file__).parents[2] / "docs" / "guide").glob("captures*.md"))


def commands_of(guide):
    blocks = re.findall(r"```sh\n(.*?)```", guide.read_text(), re.DOTALL)
    return [shlex.split(line) for block in blocks for line in block.splitlines()]


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    """Rooms by the words of their command: the guides share one."""
    return tmp_path_factory.mktemp("rooms"), {}


def photograph(words, rooms):
    folder, made = rooms
    key = tuple(word for word in words if word != words[1])
    if key not in made:
        made[key] = folder / str(len(made))
        assert main(["synth", words[0], str(made[key]), *words[2:]]) == 0, words
    shutil.copytree(made[key], words[1])


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_command_of_the_guides_does_what_it_says(guide, rooms, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)  # thousands of small files
    monkeypatch.chdir(tmp_path)
    written, carved = set(), 0
    for program, verb, *words in commands_of(guide):
        assert program == "goc"
        if verb == "carve":  # minutes: that its capture is read is enough here
            assert len(load_capture(Path(words[0]))) >= 8
            carved += 1
            continue
        if words[0] == "room":
            photograph(words, rooms)
            continue
        assert main([verb, *words]) == 0, words
        written.add(words[-1])
    said = capsys.readouterr().out
    assert carved >= 4 and all(f"The room is {name}" in said for name in written if name.startswith("as-"))
