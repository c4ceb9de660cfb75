"""Scene and objects from exact and from noisy depth of boxes, whose surfaces are known."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from boxrooms import Pose, box_room, cube, table
from cameras import looking_at
from goc.errors import ConfigError, ExtractError
from goc.events import Progress, Warned
from goc.extract import ExtractConfig, extract_objects, fuse_scene
from goc.fusion.cell_counts import count_cells, object_cells
from goc.fusion.depth_views import depth_views
from goc.scene import Evidence, StoredFrames

BOXES = {1: table(0.0, 0.7), 4: cube(0.15, 0.6, 0.72, 0.3)}
CONFIG = ExtractConfig(object_voxel=0.02, object_cells=12, scene_voxel=0.04, evidence_cells=32, evidence_pad=0.08)


SHELL = [((-2, -2, -0.2), (2, 2, 0)), ((-2, 2, -0.2), (2, 2.2, 2.4))]
SOLIDS = [*SHELL, *(box for boxes in BOXES.values() for box in boxes)]


def all_round(count=16):
    """World from camera on two circles round the table, looking at it."""
    made = []
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False)):
        position = np.array([0.1 + 1.2 * np.cos(angle), 0.65 + 1.2 * np.sin(angle), (1.4, 0.8)[index % 2]])
        made.append(looking_at(position, (0.1, 0.65, 0.6)))
    return made


@pytest.fixture(scope="module")
def room():
    return box_room(BOXES, all_round())


@pytest.fixture(scope="module")
def objects(room):
    return {found.id: found for found in extract_objects(room, CONFIG)}


def outside(points, solids):
    """Signed distance to a union of boxes, exact outside."""
    low, high = np.array(solids, float).transpose(1, 0, 2)
    gap = np.maximum(low - points[:, None], points[:, None] - high)
    return (np.linalg.norm(np.maximum(gap, 0), axis=-1) + np.minimum(gap.max(axis=-1), 0)).min(axis=1)


def test_objects_keep_their_ids_and_lie_on_their_boxes(objects):
    assert sorted(objects) == [1, 4]
    for number, found in objects.items():
        off = np.abs(outside(found.observed.mesh.vertices, BOXES[number]))
        voxel = 0.02
        assert np.median(off) < (0.1 if number == 4 else 0.25) * voxel  # the board is thinner than the truncation
        assert np.mean(off < voxel / 2) > (0.97 if number == 4 else 0.85)  # the board's rim
        assert off.max() < 4.5 * voxel
        assert found.name == f"object {number}"
        assert len(found.observed.mesh.colours) == len(found.observed.mesh.vertices)
        assert found.observed.observed.mean() > 0.9


def test_thin_legs_survive(objects):
    low = objects[1].observed.mesh.vertices[objects[1].observed.mesh.vertices[:, 2] < 0.5]
    legs = {(x > 0, y > 0.7) for x, y in low[:, :2]}
    assert len(legs) == 4
    assert low[:, 2].min() < 0.04


def test_faces_look_outwards(objects):
    mesh = objects[4].observed.mesh
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    outwards = ((a + b + c) / 3 - np.array([0.15, 0.6, 0.87])) * np.cross(b - a, c - a)
    assert (outwards.sum(axis=1) > 0).mean() > 0.99


def test_the_scene_lies_on_everything(room):
    mesh = fuse_scene(room, CONFIG)
    off = np.abs(outside(mesh.vertices, SOLIDS))
    assert np.median(off) < 0.1 * 0.04
    assert np.mean(off < 0.02) > 0.95
    assert (np.abs(outside(mesh.vertices, BOXES[4])) < 0.02).sum() > 50


def test_evidence_says_what_exact_rays_say(room, objects):
    """Oracle: exact depth along the ray through each voxel's centre, in every view, whatever the pixels show."""
    evidence = objects[4].evidence
    centres = evidence.origin + evidence.voxel * np.stack(
        np.meshgrid(*(np.arange(n) for n in evidence.state.shape), indexing="ij"), -1
    )
    points, state = centres.reshape(-1, 3), evidence.state.reshape(-1)
    sdf = outside(points, SOLIDS)
    passed = np.full(len(points), -np.inf)
    for camera in room.cameras:
        pose = camera.world_from_cam.double().numpy()
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        u, v = (local[:, :2] / local[:, 2:] * camera.focal_px.numpy() + camera.centre_px.numpy()).T
        inside = (u > 2) & (v > 2) & (u < camera.width - 2) & (v < camera.height - 2)
        depth = ray_depth(pose, points)
        passed = np.where(inside, np.maximum(passed, depth - local[:, 2]), passed)
    clear = 4 * evidence.voxel
    assert (state[sdf < -clear] != Evidence.EMPTY).all()  # nothing deep inside was seen through
    hidden = passed < -clear
    alone = outside(points, SOLIDS) > clear
    assert (hidden & alone & (state == Evidence.EMPTY)).sum() < 1e-3 * len(state)
    seen_through = (passed > clear) & (sdf > clear)
    assert seen_through.sum() > 1000
    assert (state[seen_through] == Evidence.EMPTY).mean() > 0.99
    surface = state == Evidence.SURFACE
    near = surface & (np.abs(outside(points, BOXES[4])) < evidence.voxel) & (passed > -evidence.voxel)
    error = evidence.sdf.reshape(-1)[near] - outside(points[near], BOXES[4])
    assert np.median(np.abs(error)) < 0.1 * evidence.voxel
    assert (np.abs(evidence.sdf) <= 3 * evidence.voxel * 1.001).all()


def ray_depth(pose, points):
    """Exact z of the first surface along the rays from a camera through points, infinite where there is none."""
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    rays = (points - pose[:3, 3]) / local[:, 2:]
    nearest = np.full(len(points), np.inf)
    for low, high in SOLIDS:
        with np.errstate(divide="ignore"):
            a, b = (np.array(low) - pose[:3, 3]) / rays, (np.array(high) - pose[:3, 3]) / rays
        enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
        nearest = np.where((enter < leave) & (enter > 0), np.minimum(nearest, enter), nearest)
    return nearest


def test_evidence_box_ends_below_what_the_object_stands_on(objects):
    evidence = objects[4].evidence
    assert evidence.origin[2] > 0.72 - 3 * evidence.voxel
    top = evidence.origin + evidence.voxel * (np.array(evidence.state.shape) - 1)
    assert (top >= np.array([0.3, 0.75, 1.02])).all() and (evidence.origin[:2] <= np.array([0.0, 0.45])).all()


def test_noise_and_flickering_ids_change_little(objects):
    frames = list(box_room(BOXES, all_round(), noise=0.005))
    for index, frame in enumerate(frames):
        rng = np.random.default_rng(100 + index)
        shift = tuple(int(s) for s in rng.integers(-1, 2, 2))  # ids slip by a pixel, another way in each view
        frames[index] = replace(frame, ids=torch.roll(frame.ids, shift, (0, 1)))
    noisy = replace(box_room(BOXES, all_round()), frames=StoredFrames(tuple(frames)))
    for found in extract_objects(noisy, CONFIG):
        off = np.abs(outside(found.observed.mesh.vertices, BOXES[found.id]))
        assert off.mean() < 0.006 and off.max() < 0.08
        exact = objects[found.id].observed.mesh
        assert found.observed.mesh.vertices.min(axis=0) == pytest.approx(exact.vertices.min(axis=0), abs=0.08)
        assert found.observed.mesh.vertices.max(axis=0) == pytest.approx(exact.vertices.max(axis=0), abs=0.08)


def test_a_moved_and_scaled_room_gives_the_moved_and_scaled_meshes(objects):
    """Lattices stay axis-aligned, so vertices differ; distances from the moved boxes must not."""
    angle = 0.5
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    moved = extract_objects(box_room(BOXES, all_round(), moved=Pose(turn, 2.5)), CONFIG)
    assert [found.id for found in moved] == [1, 4]
    for found in moved:
        back = found.observed.mesh.vertices / 2.5 @ turn
        off = np.abs(outside(back, BOXES[found.id]))
        assert np.mean(off < 0.01) > (0.95 if found.id == 4 else 0.8)
        assert back.min(axis=0) == pytest.approx(objects[found.id].observed.mesh.vertices.min(axis=0), abs=0.03)
        assert found.evidence.voxel > 1.5 * objects[found.id].evidence.voxel
        assert found.observed.observed.mean() > 0.9


def test_turns_do_not_change_the_result(room, objects):
    heard = []
    one_by_one = extract_objects(room, replace(CONFIG, memory_blocks=32), heard.append)
    for found in one_by_one:
        assert np.array_equal(found.observed.mesh.vertices, objects[found.id].observed.mesh.vertices)
        assert np.array_equal(found.evidence.state, objects[found.id].evidence.state)
    assert sum(event.stage == "fuse objects" for event in heard if isinstance(event, Progress)) == 2 * len(room)


def test_a_scene_that_does_not_fit_gets_larger_voxels(room):
    heard = []
    coarse = fuse_scene(room, replace(CONFIG, memory_blocks=60), heard.append)
    warned = [event.message for event in heard if isinstance(event, Warned)]
    assert len(warned) == 1 and "too large for voxels of 0.04 m in 60 blocks" in warned[0]
    assert 0 < len(coarse.faces) < len(fuse_scene(room, CONFIG).faces)


def test_a_label_that_nobody_sees_is_warned_about(room):
    heard = []
    found = extract_objects(replace(room, id_names={0: "room", 1: "table", 9: "ghost"}), CONFIG, heard.append)
    assert [item.name for item in found] == ["table", "object 4"]
    warned = [event.message for event in heard if isinstance(event, Warned)]
    assert warned == [f"Object 9 (ghost) is measured in none of {len(room)} views: no mesh for it."]


def test_captures_without_ids_or_depth_are_refused(room):
    with pytest.raises(ExtractError, match=f"None of {len(room)} views has instance ids"):
        extract_objects(replace(room, has_ids=False), CONFIG)
    frames = [replace(frame, depth=None) for frame in room]
    blind = replace(room, frames=StoredFrames(tuple(frames)), has_depth=False)
    with pytest.raises(ExtractError, match=f"None of {len(room)} views has metric depth"):
        fuse_scene(blind, CONFIG)
    with pytest.raises(ExtractError, match=f"None of {len(room)} views has metric depth"):
        extract_objects(blind, CONFIG)


def test_views_that_contradict_each_other_leave_no_scene(room):
    frames = [replace(frame, depth=torch.full_like(frame.depth, np.nan)) for frame in room]
    with pytest.raises(ExtractError, match="left no surface"):
        fuse_scene(replace(room, frames=StoredFrames(tuple(frames))), CONFIG)


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ({"object_voxel": 0.0}, "ExtractConfig.object_voxel is 0: needs more than 0"),
        ({"truncation_voxels": 1.5}, "ExtractConfig.truncation_voxels is 1.5: needs 2 to 64"),
    ],
)
def test_settings_out_of_range_are_refused(setting, text):
    with pytest.raises(ConfigError, match=text):
        ExtractConfig(**setting)


def test_cells_count_pixels_and_other_views_outvote_a_stain(room):
    views = list(depth_views(room, "", lambda event: None))
    everything = count_cells(views, 0.04, by_id=False)
    assert everything.hits.sum() == sum(int((~np.isnan(view.slope)).sum()) for view in views)
    assert set(everything.ids) == {0} and everything.views.max() <= len(views)
    clean = object_cells(count_cells(views, 0.04, by_id=True), 4)
    pixels = np.argwhere(views[0].ids == 0)[::7]
    views[0].ids[pixels[:, 0], pixels[:, 1]] = 4  # one view takes every seventh pixel of the room for the cube
    counted = count_cells(views, 0.04, by_id=True)
    stained = {tuple(cell) for cell in object_cells(counted, 4)}
    clean = {tuple(cell) for cell in clean}
    assert clean <= stained
    assert len(stained - clean) < 0.2 * ((counted.ids == 4).sum() - len(clean))  # what no other view saw stays
    assert len(object_cells(count_cells(views, 0.04, by_id=True), 8)) == 0
