"""Captures in ../shared/data load without any setting, and their frames agree with each other."""

import pytest
import torch

from goc.capture import CaptureConfig, load_capture
from goc.files import read_mesh
from goc.scene import Frame

pytestmark = pytest.mark.data


def back_project(frame: Frame):
    """World points of all measured pixels, and those pixels' mask."""
    camera, known = frame.camera, ~frame.depth.isnan()
    rows, columns = torch.nonzero(known, as_tuple=True)
    z = frame.depth[known]
    x = (columns + 0.5 - camera.centre_px[0]) / camera.focal_px[0] * z
    y = (rows + 0.5 - camera.centre_px[1]) / camera.focal_px[1] * z
    points = torch.stack([x, y, z, torch.ones_like(z)], -1) @ camera.world_from_cam.T
    return points[:, :3], known


def project(points, camera):
    local = points @ camera.cam_from_world[:3, :3].T + camera.cam_from_world[:3, 3]
    return local[:, :2] / local[:, 2:] * camera.focal_px + camera.centre_px, local[:, 2]


def disagreement(a: Frame, b: Frame):
    """(median |depth difference| of what both see, share within 5 cm, share of those with equal ids)."""
    points, known = back_project(a)
    pixels, z = project(points, b.camera)
    columns, rows = pixels.floor().long().unbind(-1)
    inside = (z > 0.05) & (columns >= 0) & (columns < b.camera.width) & (rows >= 0) & (rows < b.camera.height)
    seen = b.depth[rows[inside], columns[inside]]
    error = (z[inside] - seen).abs()
    visible = z[inside] < seen + 0.1  # the rest is hidden in b
    same = visible & (error < 0.05)
    ids = a.ids[known][inside][same] == b.ids[rows[inside], columns[inside]][same]
    return error[visible].median().item(), (same.sum() / visible.sum()).item(), ids.float().mean().item()


@pytest.mark.parametrize("room", ["living", "study", "kitchen"])
@pytest.mark.parametrize(("file", "count"), [("", 170), ("transforms_sparse.json", 50)])
def test_bench_rooms(data_root, room, file, count):
    capture = load_capture(data_root / "bench" / room / file)
    assert len(capture) == count
    assert (capture.has_depth, capture.has_ids, capture.metric, capture.units_per_metre) == (True, True, True, 1.0)
    assert sorted(capture.id_names) == list(range(11))
    median, share, ids = disagreement(capture[0], capture[1])
    assert median < 0.004  # half a pixel on slanted surfaces, and millimetres of storage
    assert share > 0.95
    assert ids > 0.98


def test_ids_of_a_bench_room_lie_on_the_ground_truth_objects(data_root):
    capture = load_capture(data_root / "bench/living")
    frame = capture[0]
    points, known = back_project(frame)
    for number in (1, 2, 6, 7):
        mesh = read_mesh(data_root / f"bench/living/gt/objects/{number}.ply")
        mine = points[frame.ids[known] == number]
        low, high = torch.tensor(mesh.vertices.min(0)), torch.tensor(mesh.vertices.max(0))
        assert ((mine > low - 0.01) & (mine < high + 0.01)).all(1).float().mean() > 0.99


def test_redkitchen(data_root):
    capture = load_capture(data_root / "real/redkitchen")
    assert len(capture) == 167
    assert (capture.has_depth, capture.has_ids, capture.metric) == (True, True, True)
    assert capture.id_names[7] == "mug_white"
    assert capture[0].ids.unique().tolist() == [-1, 0, 1, 2, 3, 6, 7, 11, 12]
    median, share, ids = disagreement(capture[10], capture[11])
    assert median < 0.012
    assert share > 0.87
    assert ids > 0.95
    assert not load_capture(data_root / "real/redkitchen", CaptureConfig(use_ids=False)).has_ids


def test_apc_shelf_labels(data_root):
    capture = load_capture(data_root / "real/apc_shelf_labels")
    assert len(capture) == 15
    assert capture[0].ids.unique().tolist() == [0, 48, 132]
    median, share, _ = disagreement(capture[0], capture[1])
    assert median < 0.008
    assert share > 0.9


def test_fox(data_root):
    assert max(load_capture(data_root / "real/fox")[0].image.shape) == 640
    capture = load_capture(data_root / "real/fox", CaptureConfig(max_side_px=1600))
    assert len(capture) == 50
    assert (capture.has_depth, capture.has_ids, capture.metric) == (False, False, False)
    assert 1 < capture.units_per_metre < 5
    frame = capture[0]
    camera = frame.camera
    assert frame.image.shape == (camera.height, camera.width, 3)
    assert 520 < camera.width <= 540
    assert 930 < camera.height <= 960
    assert frame.image.float().mean() > 20
