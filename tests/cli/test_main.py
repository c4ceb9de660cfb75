import subprocess
import sys

import pytest

from goc import __version__
from goc.cli import main


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"], ["help"]])
def test_help_names_every_command_and_gives_examples(capsys, words):
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert all(command in shown for command in ("goc demo", "goc carve", "doctor", "examples:", "--resume"))


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"goc {__version__}\n"


def test_help_answers_without_loading_anything_heavy():
    program = """
import sys
from goc.cli import main
main(["--help"])
heavy = {"torch", "numpy", "scipy", "rich", "tyro"} & set(sys.modules)
assert not heavy, heavy
"""
    subprocess.run([sys.executable, "-c", program], check=True, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize(
    ("word", "hint"), [("crave", "Did you mean `goc carve`?"), ("--frobnicate", "`goc --help` tells what there is.")]
)
def test_an_unknown_command_is_one_line_with_a_suggestion(capsys, word, hint):
    assert main([word]) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith(f"error: no command {word!r}.")
    assert hint in shown.err
    assert shown.err.count("\n") == 1


@pytest.mark.parametrize("command", ["carve", "demo", "doctor"])
def test_every_command_explains_itself(capsys, command):
    with pytest.raises(SystemExit) as left:
        main([command, "--help"])
    assert left.value.code == 0
    assert f"usage: goc {command}" in capsys.readouterr().out


def test_a_mistyped_option_is_one_line_with_a_suggestion(capsys):
    assert main(["carve", "somewhere", "--out", "out", "--iteration", "3"]) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith("error: no option --iteration. Did you mean --iterations or")
    assert shown.err.count("\n") == 1 and shown.out == ""


@pytest.mark.parametrize("command", ["synth", "osc"])
def test_a_command_of_commands_alone_explains_itself(capsys, command):
    with pytest.raises(SystemExit) as left:
        main([command])
    assert left.value.code == 0
    assert f"usage: goc {command}" in capsys.readouterr().out
