"""Scoring a room, and what exact depth reaches in the benchmark rooms."""

import numpy as np
import pytest

from goc.capture import load_capture
from goc.errors import FileError
from goc.evaluation import evaluate
from goc.evaluation.metrics import sample_surface
from goc.evaluation.rooms import score_surfaces
from goc.evaluation.truth import read_truth
from goc.extract import ExtractConfig, extract_objects, fuse_scene
from goc.scene import Mesh
from truths import write_run


def board(height):
    corners = [(0, 0, height), (1, 0, height), (1, 1, height), (0, 1, height)]
    return Mesh(vertices=np.array(corners, np.float32), faces=np.array([(0, 1, 2), (0, 2, 3)], np.int32))


@pytest.fixture
def room(tmp_path):
    """Two boards; the views saw the lower half of the first, and the second."""
    arrays, seen = {}, []
    for number in (1, 2):
        samples = sample_surface(board(float(number)), 4000, seed=number)
        arrays[f"p{number}"] = samples.points.astype(np.float32)
        arrays[f"n{number}"] = samples.normals.astype(np.float16)
        keep = (samples.points[:, 0] < 0.5) | (number == 2)
        ids = np.full((keep.sum(), 1), number)
        seen.append(np.concatenate([samples.points[keep], samples.normals[keep], ids], axis=1))
    arrays["seen"] = np.concatenate(seen).astype(np.float32)
    (tmp_path / "gt").mkdir()
    np.savez(tmp_path / "gt/points.npz", **arrays)
    return tmp_path


def test_an_object_that_is_missing_has_no_f_score_and_endless_completion(room):
    scores = score_surfaces(read_truth(room), {1: board(1.0)}, scene=board(1.0))
    assert scores.objects[1].f_score[0.05] == 1.0 and scores.objects[1].accuracy < 0.01
    assert scores.objects[2].f_score[0.05] == 0.0 and np.isinf(scores.objects[2].completion)
    assert scores.objects[1].completion_seen < 0.01 and scores.objects[1].completion_unseen < 0.01
    assert scores.scene is not None
    assert scores.scene.f_score[0.05] == pytest.approx(2 * 0.55 / 3 / (0.55 + 1 / 3), abs=0.02)


def test_a_mesh_without_faces_is_missing(room):
    empty = Mesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    scores = score_surfaces(read_truth(room), {1: empty, 2: board(2.0)}, scene=None)
    assert scores.objects[1].f_score[0.05] == 0.0 and scores.objects[2].f_score[0.05] == 1.0
    assert scores.scene is None


def test_truth_that_is_absent_or_broken_is_refused(tmp_path, room):
    with pytest.raises(FileError, match=r"none/gt/points.npz: cannot be read"):
        read_truth(tmp_path / "none")
    (room / "gt/points.npz").write_bytes(b"PK\x03\x04 cut short")
    with pytest.raises(FileError, match=r"points.npz: cannot be read"):
        read_truth(room)
    np.savez(room / "gt/points.npz", p1=np.zeros((5, 3)), seen=np.zeros((5, 7)))
    with pytest.raises(FileError, match=r"1 arrays are missing \(first: n1\)"):
        read_truth(room)


@pytest.mark.data
def test_exact_depth_reaches_the_figures_of_a_plain_fusion(data_root, tmp_path):
    """study, 50 views; a plain TSDF fusion has F@5cm 0.961, accuracy 0.0043, chamfer 0.0102 m, scene F@5cm 0.993."""
    capture = load_capture(data_root / "bench/study/transforms_sparse.json")
    objects = {found.id: found.observed.mesh for found in extract_objects(capture, ExtractConfig())}
    run = write_run(tmp_path, objects, fuse_scene(capture, ExtractConfig()))
    found = evaluate(run, data_root / "bench/study")
    assert found.missing == []
    assert found.mean["f_score_0.05"] > 0.961 and found.mean["f_score_0.01"] > 0.769
    assert found.mean["accuracy"] < 0.0043 and found.mean["chamfer"] < 0.0102
    assert found.scene is not None and found.scene["f_score_0.05"] > 0.99
