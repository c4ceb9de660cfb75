from pathlib import Path

import pytest

from captures import write_nerfstudio
from goc.cli import main
from goc.cli.carve import arguments_of
from goc.errors import ConfigError
from goc.extract import WorldConfig
from goc.pipeline import PRESETS


def test_defaults_are_the_fast_preset():
    arguments = arguments_of(["photos", "--out", "out"])
    assert (arguments.source, arguments.out) == (Path("photos"), Path("out"))
    assert arguments.config() == PRESETS["fast"]


@pytest.mark.parametrize("words", [["--preset", "paper"], ["--preset=paper"]])
def test_a_preset_gives_defaults_that_settings_change(words):
    config = arguments_of(["photos", "--out", "out", *words, "--reconstruct.sh-degree", "2"]).config()
    assert (config.reconstruct.iterations, config.reconstruct.labels) == (30_000, "learned")
    assert config.reconstruct.sh_degree == 2
    assert PRESETS["paper"].reconstruct.sh_degree == 3
    weights = PRESETS["paper"].reconstruct.losses
    assert (weights.depth, weights.depth_normal, weights.identity) == (0.3, 0.1, 0.1)
    assert (weights.photometric, weights.geometric) == (0.3, 0.3)
    rates = PRESETS["paper"].reconstruct.rates  # those of 3D Gaussian Splatting, whatever preset fast has
    assert (rates.means, rates.opacity_logits, rates.sh_constant, rates.sh_rest) == (1.6e-4, 5e-2, 2.5e-3, 1.25e-4)


def test_shortcuts_reach_their_stages():
    words = ["photos", "--out", "out", "--iterations", "7", "--seed", "5", "--overwrite", "--capture.no-use-ids"]
    config = arguments_of(words).config()
    assert (config.reconstruct.iterations, config.reconstruct.seed, config.segment.seed) == (7, 5, 5)
    assert config.export.overwrite
    assert not config.capture.use_ids
    assert config.reconstruct.mcmc == PRESETS["fast"].reconstruct.mcmc


def test_the_user_may_know_the_world_better():
    words = ["photos", "--out", "out", "--world.up", "0", "-1", "0", "--world.floor", "0.5"]
    assert arguments_of(words).config().world == WorldConfig(up=(0.0, -1.0, 0.0), floor=0.5)


@pytest.mark.parametrize("flag", ["--iterations", "--reconstruct.iterations"])
def test_a_shortcut_is_refused_as_it_was_typed(flag):
    with pytest.raises(ConfigError, match=f"^{flag} is 0: needs 1 or more"):
        arguments_of(["photos", "--out", "out", flag, "0"])


@pytest.mark.parametrize(
    "words", [["--preset", "paper", "photos", "--out", "out"], ["photos", "--preset=paper", "--out=out"]]
)
def test_a_preset_stands_anywhere(words):
    assert arguments_of(words).config() == PRESETS["paper"]


def test_help_shows_the_defaults_of_the_preset(capsys):
    shown = []
    for words in ([], ["--preset", "paper"]):
        with pytest.raises(SystemExit) as left:
            arguments_of([*words, "--help"])
        assert left.value.code == 0
        shown.append(capsys.readouterr().out)
    assert "(default: 2000)" in shown[0] and "(default: 30000)" not in shown[0]
    assert "(default: 30000)" in shown[1] and "examples:" in shown[1]


def fails(capsys, words, code):
    assert main(words) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "Traceback" not in shown.err
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1
    return shown.err


def test_wrong_input_is_one_line_and_leaves_nothing(capsys, tmp_path):
    out = tmp_path / "out"
    assert "absent: not found" in fails(capsys, ["carve", str(tmp_path / "absent"), "--out", str(out)], 3)
    (tmp_path / "transforms.json").write_text('{"frames": 3}')
    assert "transforms.json" in fails(capsys, ["carve", str(tmp_path), "--out", str(out)], 3)
    assert "--capture.units-per-metre is -1" in fails(
        capsys, ["carve", ".", "--out", str(out), "--capture.units-per-metre", "-1.0"], 2
    )
    assert "--world.up is 0 0 0: needs a direction" in fails(
        capsys, ["carve", ".", "--out", str(out), "--world.up", "0", "0", "0"], 2
    )
    assert not out.exists()


@pytest.mark.parametrize(
    "words",
    [
        ["--reconstruct.sh-degree", "7"],
        ["--reconstruct.mcmc.every", "0"],
        ["--reconstruct.holdout-every", "-3"],
        ["--segment.max-views", "0"],
    ],
)
def test_bad_settings_of_a_good_capture_are_one_line_that_spells_the_flag(capsys, tmp_path, words):
    capture = write_nerfstudio(tmp_path / "capture")
    out = tmp_path / "out"
    said = fails(capsys, ["carve", str(capture), "--out", str(out), *words], 2)
    assert said.startswith(f"error: {words[0]} is {words[1]}: needs ")
    assert not out.exists()


def test_a_full_folder_is_refused_before_the_capture_is_even_looked_at(capsys, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    said = fails(capsys, ["carve", str(tmp_path / "absent"), "--out", str(tmp_path)], 2)
    assert "is not empty (1 entries, first: notes.txt)" in said
