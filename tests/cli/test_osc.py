import numpy as np
import pytest

from goc.cli import main
from goc.files import write_mesh
from goc.scene import Mesh

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([face for a, b, c, d in QUADS for face in ((a, b, c), (a, c, d))], np.int32)


def test_help_names_the_three_commands(capsys):
    with pytest.raises(SystemExit) as left:
        main(["osc", "--help"])
    assert left.value.code == 0
    shown = capsys.readouterr().out
    assert all(command in shown for command in ("osc prepare", "osc train", "osc eval", "torchrun"))


@pytest.mark.parametrize("command", ["prepare", "train", "eval"])
def test_every_command_explains_itself(capsys, command):
    with pytest.raises(SystemExit) as left:
        main(["osc", command, "--help"])
    assert left.value.code == 0
    assert f"usage: goc osc {command}" in capsys.readouterr().out


def test_an_unknown_command_is_refused(capsys):
    assert main(["osc", "fry"]) == 2
    assert "prepare, train, eval or calibrate" in capsys.readouterr().err


def test_prepare_says_what_it_kept(tmp_path, capsys):
    write_mesh(tmp_path / "meshes" / "cube.ply", Mesh(vertices=CORNERS, faces=FACES))
    words = ["osc", "prepare", str(tmp_path / "meshes"), str(tmp_path / "out"), "--cells", "16"]
    assert main(words) == 0
    assert "1 shapes" in capsys.readouterr().out


def test_scoring_without_shapes_is_one_line(tmp_path, capsys):
    assert main(["osc", "eval", str(tmp_path), "--baselines"]) == 5
    assert "Make it with" in capsys.readouterr().err
