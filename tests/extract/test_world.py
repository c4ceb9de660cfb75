"""The world of a made room, from its mesh and its cameras, and as a user says it is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from boxrooms import Pose, box_room, cube, orbit, table
from goc.errors import ConfigError
from goc.events import Warned, ignore
from goc.extract import ExtractConfig, WorldConfig, extract_scene, fuse_scene
from goc.extract.world import find_world
from goc.scene import Gaussians, Reconstruction, StoredFrames

BOXES = {1: table(0.0, 0.7), 4: cube(0.15, 0.6, 0.72, 0.3)}
CONFIG = ExtractConfig(scene_voxel=0.04, object_voxel=0.04, object_cells=8, evidence_cells=16)
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
LEANING = np.array([[0.8, 0.0, 0.6], [0.36, 0.8, -0.48], [-0.48, 0.6, 0.64]])


def world_of(room, notify=ignore, **given):
    return find_world(fuse_scene(room, CONFIG), room, WorldConfig(**given), notify)


@pytest.mark.parametrize(("turn", "scale"), [(np.eye(3), 1.0), (Y_UP, 3.0), (LEANING, 0.5)])
def test_a_room_stands_on_its_floor_in_metres_wherever_it_came_from(turn, scale):
    room = box_room(BOXES, moved=Pose(turn, scale), size=(96, 72))
    world = world_of(room)
    assert np.degrees(np.arccos(min(1.0, world.up @ turn[:, 2]))) < 0.7
    assert world.confidence > 0.8 and world.metric and world.units_per_metre == scale
    level = world.level_from_world
    assert np.linalg.det(level[:3, :3]) == pytest.approx(scale**-3)  # right-handed
    corners = np.array([[-1.0, -1, 0], [1, 1, 0], [0.15, 0.6, 1.02]]) * scale @ turn.T
    heights = (corners @ level[:3, :3].T + level[:3, 3])[:, 2]
    assert heights == pytest.approx([0.0, 0.0, 1.02], abs=0.03)


def test_the_same_room_gives_the_same_world_whatever_the_order_of_its_faces():
    room = box_room(BOXES, size=(96, 72))
    mesh = fuse_scene(room, CONFIG)
    one = find_world(mesh, room, WorldConfig())
    other = find_world(replace(mesh, faces=np.ascontiguousarray(mesh.faces[::-1])), room, WorldConfig())
    assert np.array_equal(one.up, other.up) and one.floor == pytest.approx(other.floor, abs=1e-6)


def test_what_the_user_says_is_taken():
    room = box_room(BOXES, size=(96, 72))
    world = world_of(room, up=(0.0, 0.0, 9.81))
    assert world.up.tolist() == [0.0, 0.0, 1.0] and world.confidence == pytest.approx(1.0, abs=0.05)
    sideways = world_of(room, up=(0.0, -1.0, 0.0), floor=-2.0)
    assert sideways.up.tolist() == [0.0, -1.0, 0.0] and sideways.floor == -2.0 and sideways.confidence == 1.0


def test_the_format_knows_up_roughly_and_planes_exactly():
    room = box_room(BOXES, size=(96, 72))
    tilted = (0.05, 0.0, 1.0)  # 3 degrees off, as a phone may be
    exact = world_of(replace(room, up=tilted)).up
    assert np.degrees(np.arccos(min(1.0, exact[2]))) < 0.7
    sideways = world_of(replace(room, up=(0.0, 2.0, 0.0))).up  # no plane that was found says so: the format is believed
    assert sideways.tolist() == [0.0, 1.0, 0.0]
    assert world_of(replace(room, up=(0.0, 1.0, 0.0)), up=(0.0, 0.0, 1.0)).up.tolist() == [0.0, 0.0, 1.0]


def test_a_world_that_only_cameras_tell_of_is_warned_about():
    away = [np.array(pose) for pose in orbit(4)]
    room = box_room({}, away, size=(96, 72))
    wall = [replace(frame, depth=torch.where(frame.depth > 2.0, frame.depth, torch.nan)) for frame in room]
    floorless = [replace(frame, depth=_above(frame, 0.1)) for frame in wall]
    heard = []
    world = world_of(replace(room, frames=StoredFrames(tuple(floorless))), heard.append)
    assert [event.message for event in heard if isinstance(event, Warned)] == [
        "No level surface tells which way is up: guessed from the cameras. Pass --world.up if it is wrong."
    ]
    assert world.confidence < 0.1


def _above(frame, height):
    """Depth of what lies above a height; NaN elsewhere."""
    camera = frame.camera
    v, u = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    x, y = (u + 0.5 - camera.centre_px[0]) / camera.focal_px[0], (v + 0.5 - camera.centre_px[1]) / camera.focal_px[1]
    rays = torch.stack([x, y, torch.ones_like(x)], -1) @ camera.world_from_cam[:3, :3].T
    z = camera.position[2] + rays[..., 2] * frame.depth
    return torch.where(z > height, frame.depth, torch.nan)


def test_the_stage_hands_on_a_scene():
    room = replace(box_room(BOXES, size=(96, 72)), id_names={0: "room", 4: "cube"})
    count = 6
    splats = Gaussians(
        means=torch.arange(3.0 * count).reshape(count, 3),
        quats=torch.eye(4)[:1].expand(count, 4),
        log_scales=torch.zeros(count, 3),
        opacity_logits=torch.zeros(count),
        sh=torch.zeros(count, 1, 3),
    )
    labels = torch.tensor([0, 4, 1, 4, -1, 9], dtype=torch.int16)
    made = Reconstruction(gaussians=splats, labels=labels, metrics={"psnr_db": 20.0})
    scene = extract_scene(made, room, CONFIG, WorldConfig())
    assert [(item.id, item.name, len(item.splats)) for item in scene.objects] == [(1, "object 1", 1), (4, "cube", 2)]
    assert torch.equal(scene.objects[1].splats.means, splats.means[[1, 3]])
    assert all(item.solid is None and item.evidence is not None for item in scene.objects)
    assert list(scene.cameras) == list(room.view_names)
    assert scene.metrics == {"psnr_db": 20.0} and scene.world.confidence > 0.8


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"up": (0.0, 0.0, 0.0)}, "up is 0 0 0: needs a direction, such as 0 0 1"),
        ({"up": (0.0, float("nan"), 1.0)}, "up is 0 nan 1: needs a finite number"),
        ({"floor": float("inf")}, "floor is inf: needs a finite number"),
    ],
)
def test_a_world_that_is_none_is_refused(given, text):
    with pytest.raises(ConfigError, match=text):
        WorldConfig(**given)
