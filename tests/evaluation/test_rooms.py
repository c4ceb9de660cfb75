"""Scoring a room, and what exact depth reaches in the benchmark rooms."""

import numpy as np
import pytest

from goc.capture import load_capture
from goc.errors import FileError
from goc.evaluation.metrics import sample_surface
from goc.evaluation.rooms import score_room
from goc.extract import ExtractConfig, extract_objects, fuse_scene
from goc.scene import Mesh


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


def test_the_truth_scores_perfectly_and_a_missing_object_counts(room):
    scores = score_room(room, {1: board(1.0)}, scene=board(1.0))
    assert scores.missing == (2,)
    assert scores.objects[1].f_score[0.05] == 1.0 and scores.objects[2].f_score[0.05] == 0.0
    mean = scores.mean()
    assert mean["f_score_0.05"] == 0.5  # the missing one counts
    assert mean["accuracy"] == scores.objects[1].accuracy < 0.01  # lengths: of those present
    assert scores.objects[1].completion_seen < 0.01 and scores.objects[1].completion_unseen < 0.01
    assert scores.scene is not None
    assert scores.scene.f_score[0.05] == pytest.approx(2 * 0.55 / 3 / (0.55 + 1 / 3), abs=0.02)


def test_a_mesh_without_faces_is_missing(room):
    empty = Mesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    assert score_room(room, {1: empty, 2: board(2.0)}).missing == (1,)
    assert score_room(room, {1: board(1.0), 2: board(2.0)}).scene is None


def test_truth_that_is_absent_or_broken_is_refused(tmp_path, room):
    with pytest.raises(FileError, match=r"none/gt/points.npz: cannot be read"):
        score_room(tmp_path / "none", {})
    (room / "gt/points.npz").write_bytes(b"PK\x03\x04 cut short")
    with pytest.raises(FileError, match=r"points.npz: cannot be read"):
        score_room(room, {})
    np.savez(room / "gt/points.npz", p1=np.zeros((5, 3)), seen=np.zeros((5, 7)))
    with pytest.raises(FileError, match=r"1 arrays are missing \(first: n1\)"):
        score_room(room, {})


@pytest.mark.data
def test_exact_depth_reaches_the_figures_in_measured_md(data_root):
    """study, 50 views: F@5cm 0.961, accuracy 0.0043, chamfer 0.0102 m, scene F@5cm 0.993 in measured.md."""
    capture = load_capture(data_root / "bench/study/transforms_sparse.json")
    objects = {found.id: found.mesh for found in extract_objects(capture, ExtractConfig())}
    scores = score_room(data_root / "bench/study", objects, fuse_scene(capture, ExtractConfig()))
    mean = scores.mean()
    assert scores.missing == ()
    assert mean["f_score_0.05"] > 0.961 and mean["f_score_0.01"] > 0.769
    assert mean["accuracy"] < 0.0043 and mean["chamfer"] < 0.0102
    assert scores.scene is not None and scores.scene.f_score[0.05] > 0.99
