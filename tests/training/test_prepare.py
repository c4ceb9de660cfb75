import time

import numpy as np
import pytest

from goc.errors import TrainError
from goc.files import write_mesh
from goc.scene import Mesh
from goc.training import prepare as preparing
from goc.training.library import ShapeLibrary
from goc.training.prepare import PrepareConfig, find_meshes, prepare

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([face for a, b, c, d in QUADS for face in ((a, b, c), (a, c, d))], np.int32)
COARSE = PrepareConfig(cells=16)


def box(*sides):
    return Mesh(vertices=CORNERS * np.array(sides, np.float32), faces=FACES)


@pytest.fixture
def meshes(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    write_mesh(folder / "cube.ply", box(1, 1, 1))
    write_mesh(folder / "slab.ply", box(2, 1, 0.3))
    (folder / "broken.ply").write_bytes(b"ply\nnonsense")
    return folder


def test_good_meshes_are_kept_and_bad_ones_told(meshes, tmp_path):
    heard = []
    manifest = prepare(meshes, tmp_path / "out", COARSE, heard.append)
    assert sorted(shape.name for shape in manifest.kept) == ["cube", "slab"]
    assert [mesh.name for mesh in manifest.dropped] == ["broken"]
    assert "broken.ply" in manifest.dropped[0].why
    assert heard[-1].done == heard[-1].total == 3
    library = ShapeLibrary(tmp_path / "out", "train")
    by_name = {shape.name: library[i] for i, shape in enumerate(library.shapes)}
    inside = by_name["slab"].distances(np.array([[0.0, 0, 0.07], [0, 0, 0.3], [0.45, 0.2, 0.05]]))
    assert (inside < 0).tolist() == [True, False, True]
    assert np.ptp(by_name["cube"].mesh.vertices, axis=0) == pytest.approx([1, 1, 1], abs=0.02)


def test_a_second_run_does_what_is_left(meshes, tmp_path, monkeypatch):
    prepare(meshes, tmp_path / "out", COARSE)
    write_mesh(meshes / "tower.ply", box(1, 1, 3))
    asked = []
    worked = preparing._worked
    monkeypatch.setattr(preparing, "_worked", lambda sources, config: worked(asked.append(sources) or sources, config))
    manifest = prepare(meshes, tmp_path / "out", COARSE)
    assert [source.name for source in asked[0]] == ["tower"]
    assert len(manifest.kept) == 3
    assert len(ShapeLibrary(tmp_path / "out", "train")) == 3


def test_a_mesh_that_takes_too_long_is_given_up(meshes, tmp_path):
    began = time.monotonic()
    manifest = prepare(meshes, tmp_path / "out", PrepareConfig(cells=16, seconds=0.001))
    assert len(manifest.kept) + len(manifest.dropped) == 3
    assert any("took longer" in mesh.why for mesh in manifest.dropped)
    assert time.monotonic() - began < 200


def test_a_table_tells_the_split(meshes):
    (meshes / "objects.csv").write_text("file,name,split\ncube.ply,a cube,val\nslab.ply,slab,train\n")
    found = {source.name: source.split for source in find_meshes(meshes)}
    assert found == {"a cube": "val", "slab": "train"}


@pytest.mark.parametrize(
    ("table", "match"),
    [("file,name,split\nnone.ply,x,train\n", "which is not there"), ("file,name,split\ncube.ply,x,test\n", "bad row")],
)
def test_a_table_that_cannot_be_followed_is_refused(meshes, table, match):
    (meshes / "objects.csv").write_text(table)
    with pytest.raises(TrainError, match=match):
        find_meshes(meshes)


def test_what_is_not_there_is_refused(tmp_path):
    with pytest.raises(TrainError, match="holds no meshes"):
        find_meshes(tmp_path)
    with pytest.raises(TrainError, match="Make it with"):
        ShapeLibrary(tmp_path, "train")
    (tmp_path / "manifest.json").write_text('{"kept": [], "dropped": []}')
    with pytest.raises(TrainError, match="is of split val"):
        ShapeLibrary(tmp_path, "val")
