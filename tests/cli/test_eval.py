import json

import pytest

from goc.cli import main
from truths import CRATE, CUPBOARD, write_run, write_truth


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    return write_truth(tmp_path_factory.mktemp("room"))


def test_a_run_is_judged_and_the_table_says_what_came_out(capsys, truth, tmp_path):
    run = write_run(tmp_path / "run", {1: CRATE})
    assert main(["eval", str(run), "--truth", str(truth), "--worst", "0"]) == 0
    shown = capsys.readouterr()
    assert "1 of 2 objects found; missing: 2; 1 watertight;" in " ".join(shown.out.split())
    assert "F 5 cm" in shown.out and "2 cupboard" in shown.out and str(run / "eval.json") in shown.out
    assert json.loads((run / "eval.json").read_text())["mean"]["f_score_0.05"] == pytest.approx(0.5, abs=1e-3)
    assert (run / "eval.html").exists()


def test_settings_reach_the_judge(capsys, truth, tmp_path):
    run = write_run(tmp_path / "run", {5: CRATE, 6: CUPBOARD})
    out = tmp_path / "judged"
    words = ["--match", "shape", "--meshes", "observed", "--seed", "3", "--worst", "0", "--out", str(out)]
    assert main(["eval", str(run), "--truth", str(truth / "transforms.json"), *words]) == 0
    found = json.loads((out / "eval.json").read_text())
    assert (found["matching"], found["meshes"], found["settings"]["seed"]) == ("shape", "observed", 3)
    assert found["objects"]["1"]["predicted"] == 5 and not (run / "eval.json").exists()
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "text", "code"),
    [
        (["--truth", "{truth}", "--worst", "-1"], "--worst is -1: needs 0 or more", 2),
        (["--truth", "{truth}", "--seed", "-1"], "--seed is -1: needs 0 or more", 2),
        (["--truth", "{run}"], "points.npz: cannot be read", 3),
    ],
)
def test_misuse_is_one_line(capsys, truth, tmp_path, words, text, code):
    run = write_run(tmp_path / "run", {1: CRATE})
    given = [word.format(truth=truth, run=run) for word in words]
    assert main(["eval", str(run), *given]) == code
    shown = capsys.readouterr()
    assert text in shown.err and shown.err.count("\n") == 1 and shown.out == ""
