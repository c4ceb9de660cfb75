import hashlib
import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from goc import _native
from goc.capture.load import load_capture
from goc.errors import ConfigError, ExportError
from goc.events import Progress
from goc.files.images import read_ids, read_image
from goc.files.meshes import read_mesh
from goc.files.rasters import read_depth
from goc.synth.captures import RoomConfig, make_room_capture
from oracles import raycast as oracle

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


class View:
    """One view, read back with nothing but the files layer."""

    def __init__(self, folder, document, frame):
        self.pose = np.array(frame["transform_matrix"]) @ OPENCV_FROM_OPENGL
        self.image = read_image(folder / frame["file_path"])
        self.depth = read_depth(folder / frame["depth_file_path"]).astype(np.float64)
        self.ids = read_ids(folder / frame["instance_file_path"])
        self.intrinsics = np.array([document[name] for name in ("fl_x", "fl_y", "cx", "cy")])

    def rays(self):
        """Camera rays with z = 1, world, (h·w 3)."""
        fx, fy, cx, cy = self.intrinsics
        height, width = self.depth.shape
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        return np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], -1).reshape(-1, 3) @ self.pose[:3, :3].T

    def points(self):
        return self.pose[:3, 3] + self.depth.reshape(-1, 1) * self.rays()


@pytest.fixture(scope="module")
def views(demo_capture):
    folder, _ = demo_capture
    document = json.loads((folder / "transforms.json").read_text())
    return [View(folder, document, frame) for frame in document["frames"]]


@pytest.fixture(scope="module")
def truth(demo_capture, demo_config):
    """Vertices, faces and owner of every ground-truth triangle."""
    folder, _ = demo_capture
    meshes = [read_mesh(folder / "gt" / "room.ply")]
    meshes += [read_mesh(folder / "gt" / "objects" / f"{key}.ply") for key in range(1, demo_config.objects + 1)]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    return np.concatenate([mesh.vertices for mesh in meshes]), faces, owner


def test_depth_and_ids_are_those_of_the_ground_truth_meshes(views, truth):
    vertices, faces, owner = truth
    rng = np.random.default_rng(0)
    for view in views[::3]:
        chosen = rng.choice(view.depth.size, 60, replace=False)
        origins = np.repeat(view.pose[None, :3, 3], len(chosen), 0)
        t, triangle = oracle.closest_hits(vertices, faces, origins, view.rays()[chosen])
        exact = np.abs(view.depth.ravel()[chosen] - t) < 0.0006  # half a millimetre of quantisation
        assert exact.mean() >= 0.98  # a ray along an edge may take either side
        assert (view.ids.ravel()[chosen] == owner[triangle])[exact].all()


def test_points_of_one_view_never_hide_behind_what_another_view_saw_through(views, demo_config):
    for a, b in [(0, 1), (1, 3), (4, 2), (5, 0)]:
        local = (views[a].points() - views[b].pose[:3, 3]) @ views[b].pose[:3, :3]
        fx, fy, cx, cy = views[b].intrinsics
        z = np.maximum(local[:, 2], 1e-6)
        column, row = np.floor(fx * local[:, 0] / z + cx), np.floor(fy * local[:, 1] / z + cy)
        inside = (
            (local[:, 2] > 0.1) & (column >= 0) & (column < demo_config.width) & (row >= 0) & (row < demo_config.height)
        )
        index = row[inside].astype(int), column[inside].astype(int)
        behind = views[b].depth[index] - local[inside, 2]
        # A surface in front of what the pixel measured would have been measured; half a pixel of slope is allowed.
        assert (behind < 0.1 * local[inside, 2]).mean() > 0.97
        same = np.abs(behind) < 0.01
        ids = views[a].ids.ravel()[inside]
        if same.sum() > 100:
            assert (views[b].ids[index] == ids)[same].mean() > 0.9  # at contacts a neighbour is as near


def test_the_capture_reader_takes_the_folder_as_it_is(demo_capture, demo_config, views):
    capture = load_capture(demo_capture[0])
    assert len(capture) == demo_config.views and capture.has_depth and capture.has_ids and capture.metric
    assert capture.id_names[1] == "sofa"
    frame = capture[3]
    np.testing.assert_allclose(frame.camera.world_from_cam.numpy(), views[3].pose, atol=1e-6)
    np.testing.assert_array_equal(frame.ids.numpy(), views[3].ids)
    np.testing.assert_allclose(frame.depth.numpy(), views[3].depth, atol=1e-6)


def test_true_samples_are_the_open_surface_of_the_meshes(demo_capture, demo_config, truth):
    folder, _ = demo_capture
    vertices, faces, owner = truth
    with np.load(folder / "gt" / "points.npz") as archive:
        samples = dict(archive)
    assert len(samples) == 2 * demo_config.objects + 1
    rng = np.random.default_rng(0)
    for key in (1, 8):  # the sofa, whose cushions overlap, and the books, which lie on each other
        own = faces[owner == key]
        chosen = rng.choice(30_000, 25, replace=False)
        points, normals = samples[f"p{key}"][chosen], samples[f"n{key}"][chosen]
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-5)
        down, _ = oracle.closest_hits(vertices, own, points + 1e-3 * normals, -normals.astype(np.float64))
        assert (np.abs(down - 1e-3) < 2e-4).mean() > 0.9  # at a join, another part may lie between


def test_seen_samples_are_what_the_views_measured(demo_capture, views):
    with np.load(demo_capture[0] / "gt" / "points.npz") as archive:
        seen = archive["seen"]
    assert len(seen) <= 250_000 and set(np.unique(seen[:, 6])) >= {0.0, 1.0, 2.0}
    tree = cKDTree(np.concatenate([view.points() for view in views]))
    chosen = np.random.default_rng(0).choice(len(seen), 500, replace=False)
    near, _ = tree.query(seen[chosen, :3])
    assert (near < 0.12).mean() > 0.95  # pixels of this small capture are up to 8 cm apart on far walls
    other, _ = cKDTree(seen[:, :3]).query(views[0].points())
    assert (other < 0.04).mean() > 0.97


def test_images_look_lit(views):
    for view in views:
        assert 30 < view.image.mean() < 225
        assert view.image.std() > 15


def test_the_folder_is_complete_and_progress_is_heard(demo_capture, demo_config):
    folder, heard = demo_capture
    labels = json.loads((folder / "labels.json").read_text())
    assert labels["0"] == "room" and len(labels) == demo_config.objects + 1
    for kind in ("images", "depth", "instance"):
        assert len(list((folder / kind).iterdir())) == demo_config.views
    told = [(event.done, event.total) for event in heard if isinstance(event, Progress)]
    assert told == [(number, demo_config.views) for number in range(1, demo_config.views + 1)]


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(demo_capture, demo_config, tmp_path):
    threads = _native.thread_count()
    try:
        _native.set_thread_count(1 if threads > 1 else 2)
        again = make_room_capture(tmp_path / "again", demo_config)
    finally:
        _native.set_thread_count(threads)
    assert digests(again) == digests(demo_capture[0])


def digests(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_a_folder_with_something_in_it_is_refused(demo_config, tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(ExportError, match="not an empty folder"):
        make_room_capture(tmp_path, demo_config)
    with pytest.raises(ExportError, match="not an empty folder"):
        make_room_capture(tmp_path / "mine.txt", demo_config)


@pytest.mark.parametrize(("name", "value"), [("views", 7), ("width", 0), ("objects", 1), ("samples", 0), ("seed", -1)])
def test_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ConfigError, match=f"RoomConfig.{name} is {value}: needs"):
        RoomConfig(**{name: value})
