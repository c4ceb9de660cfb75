import hashlib
import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from goc import _native
from goc.cli import main
from goc.errors import ConfigError
from goc.evaluation.rooms import score_surfaces
from goc.evaluation.truth import read_truth
from goc.events import Warned, ignore
from goc.files import read_ids, read_image, read_mesh, write_mesh
from goc.synth.assets import MeshFolder
from goc.synth.captures import RoomConfig, make_room_capture
from goc.synth.collision import collision_mesh
from goc.synth.mesh_room import furnish_with_meshes
from goc.synth.shapes import rounded_box
from meshfolder import mesh_of, write_folder
from oracles import raycast as oracle

COUNT = 9


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    return MeshFolder(meshes=write_folder(tmp_path_factory.mktemp("meshes") / "folder"))


@pytest.fixture(scope="module")
def config(meshes):
    return RoomConfig(
        seed=3, views=16, sparse_views=4, width=64, height=64, objects=COUNT, samples=1, normals=True, images="jpg",
        furniture=meshes,
    )  # fmt: skip


@pytest.fixture(scope="module")
def capture(config, tmp_path_factory):
    heard = []
    return make_room_capture(tmp_path_factory.mktemp("rooms") / "room", config, heard.append), heard


@pytest.fixture(scope="module")
def room(meshes):
    return furnish_with_meshes(3, COUNT, meshes, ignore)


def solids(room):
    """Vertices and faces of each thing, as the oracle wants them."""
    hulls = {key: collision_mesh(model).scene for key, model in room.objects.items()}
    return {key: (scene.vertices.astype(float), scene.faces) for key, scene in hulls.items()}


def digests(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_no_two_things_share_space(room):
    """Twin of goc.synth.collision: every edge against every triangle, lifted by a millimetre where things touch."""
    shapes = solids(room)
    compared = 0
    for a, (mine, faces) in shapes.items():
        for b, (other, other_faces) in shapes.items():
            lift = np.array([0, 0, np.sign(mine[:, 2].min() - other[:, 2].min()) * 1e-3])
            low, high = np.maximum(mine.min(0) + lift, other.min(0)), np.minimum(mine.max(0) + lift, other.max(0))
            if a == b or (low > high).any():
                continue
            compared += 1
            edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1), axis=0)
            starts, ends = mine[edges[:, 0]] + lift, mine[edges[:, 1]] + lift
            near = ((np.minimum(starts, ends) <= high) & (np.maximum(starts, ends) >= low)).all(1)
            if near.any():
                t, _ = oracle.closest_hits(other, other_faces, starts[near], (ends - starts)[near])
                assert (t > 1).all(), (room.objects[a].name, room.objects[b].name)
    assert all((np.abs(vertices[:, :2]) <= room.size.half[:2]).all() for vertices, _ in shapes.values())


def test_everything_touches_the_floor_or_what_it_stands_on(room):
    shapes = solids(room)
    lifted = 0
    for key, (vertices, _) in shapes.items():
        bottom = vertices[:, 2].min()
        if bottom < 0.002:
            assert bottom == pytest.approx(0, abs=1e-6)
            continue
        lifted += 1
        feet = vertices[vertices[:, 2] < bottom + 0.02]
        gaps = []
        for other, (below, faces) in shapes.items():
            if other != key:
                start = feet + np.array([0, 0, 0.01])
                t, _ = oracle.closest_hits(below, faces, start, np.broadcast_to([1e-6, 2e-6, -1.0], start.shape))
                gaps.append(t.min() - 0.01)
        assert abs(min(gaps)) < 0.002
    assert lifted >= 3


def test_large_things_stand_on_the_floor_and_small_ones_mostly_on_them(room):
    names = {model.name: model.bounds[0][2] for model in room.objects.values()}
    assert len(names) == COUNT
    assert all(names[name] < 1e-6 for name in ("table", "low", "chair") if name in names)
    assert sum(z > 0.3 for z in names.values()) >= 3


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(capture, config, tmp_path):
    threads = _native.thread_count()
    try:
        _native.set_thread_count(1 if threads > 1 else 2)
        again = make_room_capture(tmp_path / "again", config)
    finally:
        _native.set_thread_count(threads)
    assert digests(again) == digests(capture[0])


def test_every_thing_is_in_some_view_and_nobody_was_warned_of_one(capture):
    folder, heard = capture
    seen: set[int] = set()
    for path in (folder / "instance").iterdir():
        seen |= set(np.unique(read_ids(path)).tolist())
    assert seen == set(range(COUNT + 1))
    assert not [event for event in heard if isinstance(event, Warned) and "in no view" in event.message]


def test_lists_name_files_that_are_there(capture, config):
    folder, _ = capture
    full = json.loads((folder / "transforms.json").read_text())["frames"]
    sparse = json.loads((folder / "transforms_sparse.json").read_text())["frames"]
    assert [full.index(frame) for frame in sparse] == [0, 5, 10, 15]
    for frame in full:
        for name in ("file_path", "depth_file_path", "instance_file_path", "normal_file_path"):
            assert (folder / frame[name]).is_file()


def test_normals_are_unit_and_face_the_camera(capture):
    for path in (capture[0] / "normal").iterdir():
        normals = read_image(path).astype(float) / 127.5 - 1
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=0.02)
    floor = read_image(capture[0] / "normal/0000.png")[-1, 32].astype(float) / 127.5 - 1
    pose = np.array(json.loads((capture[0] / "transforms.json").read_text())["frames"][0]["transform_matrix"])
    assert (pose[:3, :3] @ np.diag([1, -1, -1]) @ floor)[2] > 0.98  # below is the floor, or a top


def test_true_samples_lie_on_the_true_meshes_and_score_perfectly(capture):
    folder, _ = capture
    meshes = {key: read_mesh(folder / f"gt/objects/{key}.ply") for key in range(1, COUNT + 1)}
    with np.load(folder / "gt/points.npz") as archive:
        for key, mesh in meshes.items():
            points, normals = archive[f"p{key}"], archive[f"n{key}"]
            assert len(points) == 30_000
            chosen = np.random.default_rng(key).choice(30_000, 40, replace=False)
            start = points[chosen] + 1e-3 * normals[chosen]
            t, _ = oracle.closest_hits(mesh.vertices.astype(float), mesh.faces, start, -normals[chosen].astype(float))
            assert (np.abs(t - 1e-3) < 1e-4).mean() > 0.9
        seen = archive["seen"]
    assert set(np.unique(seen[:, 6])) == {float(key) for key in range(COUNT + 1)}
    near, _ = cKDTree(np.concatenate([mesh.vertices for mesh in meshes.values()])).query(seen[seen[:, 6] > 0, :3])
    assert near.max() < 0.7
    scores = score_surfaces(read_truth(folder), {key: meshes[key] for key in (1, COUNT)}, scene=None)
    assert scores.objects[COUNT].f_score[0.01] > 0.99
    assert [key for key in sorted(scores.objects) if scores.objects[key].f_score[0.05] > 0] == [1, COUNT]


def test_built_in_furniture_holds_what_a_folder_has_nothing_for(tmp_path):
    for index in range(6):
        solid = rounded_box((0.12, 0.1, 0.08 + 0.02 * index))
        write_mesh(tmp_path / f"block{index}.ply", mesh_of(solid))
    room = furnish_with_meshes(0, 6, MeshFolder(meshes=tmp_path), ignore)
    names = [model.name for model in room.objects.values()]
    assert "coffee table" in names and sum(name.startswith("block") for name in names) == 4
    assert all(model.bounds[0][2] > 0.1 for model in room.objects.values() if model.name.startswith("block"))


def test_misuse_is_refused(tmp_path, meshes, capsys, monkeypatch):
    monkeypatch.setattr("goc.synth.mesh_room._ATTEMPTS", 2)
    with pytest.raises(ConfigError, match="no mesh is of use in a room"):
        furnish_with_meshes(0, 6, MeshFolder(meshes=meshes.folder, max_m=0.07), ignore)
    with pytest.raises(ConfigError, match="no place found for 30 things"):
        furnish_with_meshes(0, 30, meshes, ignore)
    with pytest.raises(ConfigError, match="RoomConfig.objects is 30: built-in rooms have 6 to 16"):
        make_room_capture(tmp_path / "out", RoomConfig(objects=30))
    assert main(["synth", "room", str(tmp_path / "out"), "--split", "val"]) == 2
    assert "are for meshes. Add --meshes FOLDER" in capsys.readouterr().err
    assert main(["synth", "room", str(tmp_path / "out"), "--meshes", str(tmp_path)]) == 3
    assert "holds no meshes" in capsys.readouterr().err


def test_the_command_makes_a_benchmark_room(tmp_path, capsys, monkeypatch):
    asked = []
    monkeypatch.setattr("goc.cli.synth.make_room_capture", lambda out, config, notify: asked.append((out, config)))
    assert main(["synth", "room", str(tmp_path), "--meshes", "things", "--up", "y", "--objects", "30"]) == 0
    assert main(["synth", "room", str(tmp_path), "--seed", "2"]) == 0
    assert "goc carve" in capsys.readouterr().out
    (out, first), (_, second) = asked
    assert out == tmp_path and (first.furniture.folder.name, first.furniture.up, first.objects) == ("things", "y", 30)
    assert (second.views, second.sparse_views, second.width, second.height) == (170, 50, 384, 384)
    assert second.furniture.meshes is None and (second.seed, second.objects, second.images) == (2, 10, "jpg")
