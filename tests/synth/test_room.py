import itertools

import numpy as np
import pytest

from goc.errors import ConfigError
from goc.geometry.raycast import TriangleScene
from goc.synth import room as room_module
from goc.synth.cameras import CLEARANCE, camera_path
from goc.synth.layout import UprightBox
from goc.synth.model import mesh_of
from goc.synth.room import furnish_room
from oracles.watertight import signed_volume, trouble

SEEDS = [0, 1, 2, 3, 4]


def inside_parts(model, points):
    """Whether each point lies inside some part: the first surface above it is seen from behind."""
    inside = np.zeros(len(points), bool)
    up = np.broadcast_to(np.array([0.0123, 0.0217, 1.0]), points.shape)
    for item in model.parts:
        corners = item.mesh.vertices[item.mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        hits = TriangleScene(item.mesh.vertices.astype(np.float32), item.mesh.faces).closest_hit(points, up)
        inside |= hits.found & ((normals[hits.triangle] * up).sum(-1) > 0)
    return inside


def just_inside(model, depth=0.002):
    """Points `depth` under the surface, at all face centres."""
    points = []
    for item in model.parts:
        corners = item.mesh.vertices[item.mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        points.append(corners.mean(1) - depth * normals / np.linalg.norm(normals, axis=-1, keepdims=True))
    return np.concatenate(points)


@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_hold_closed_things_that_stand_somewhere_and_not_in_each_other(seed):
    room = furnish_room(seed, 12)
    assert list(room.objects) == list(range(1, 13))
    bounds = {key: model.bounds for key, model in room.objects.items()}
    for key, (low, high) in bounds.items():
        assert (np.abs([low[:2], high[:2]]) < room.size.half[:2]).all() and high[2] < room.size.height
        rests = [0.0] + [other[1][2] for number, other in bounds.items() if number != key]
        assert min(abs(low[2] - level) for level in rests) < 1e-9
        mesh = mesh_of(room.objects[key])
        assert trouble(mesh.vertices, mesh.faces) == ""
    for a, b in itertools.permutations(bounds, 2):
        if (bounds[a][0] < bounds[b][1]).all() and (bounds[b][0] < bounds[a][1]).all():
            assert not inside_parts(room.objects[a], just_inside(room.objects[b])).any(), (a, b)


def test_the_room_is_a_closed_box_seen_from_inside(room):
    mesh = mesh_of(room.shell)
    volume = signed_volume(mesh.vertices, mesh.faces)
    assert volume == pytest.approx(-room.size.width * room.size.depth * room.size.height, rel=1e-6)
    assert trouble(mesh.vertices, mesh.faces[:, ::-1]) == ""


def test_more_objects_than_fit_are_refused(monkeypatch):
    monkeypatch.setattr(room_module, "_ATTEMPTS", 0)
    with pytest.raises(ConfigError, match="seed 5: no place found for 12 objects in 0 attempts"):
        furnish_room(5, 12)


@pytest.mark.parametrize(
    ("x", "yaw", "apart"), [(1.9, 0.0, False), (2.05, 0.0, True), (2.05, 0.8, False), (2.5, 0.8, True)]
)
def test_footprints_are_apart_when_some_side_separates_them(x, yaw, apart):
    first = UprightBox(centre=np.zeros(2), half=np.ones(2), yaw=0.0, low=0.0, high=1.0)
    second = UprightBox(centre=np.array([x, 0.0]), half=np.ones(2), yaw=yaw, low=0.5, high=2.0)
    assert first.apart(second, 0.0) is apart
    assert second.apart(first, 0.0) is apart
    above = UprightBox(centre=np.zeros(2), half=np.ones(2), yaw=0.3, low=1.0, high=2.0)
    assert first.apart(above, 0.5)


@pytest.mark.parametrize("seed", [0, 1])
def test_cameras_keep_their_distance_and_see_every_object_often(seed):
    room = furnish_room(seed, 12)
    meshes = [mesh_of(room.shell)] + [mesh_of(model) for model in room.objects.values()]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    scene = TriangleScene(np.concatenate([mesh.vertices for mesh in meshes]), faces.astype(np.int32))
    cameras = camera_path(room, scene, 60, 80, 60, seed)
    assert len(cameras) == 60
    directions = np.random.default_rng(0).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    seen = np.zeros(len(meshes), int)
    for camera in cameras:
        pose = camera.world_from_cam.numpy().astype(np.float64)
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-6)
        assert pose[2, 1] < 0  # the camera's y points down
        near = scene.closest_hit(np.broadcast_to(pose[:3, 3], directions.shape), directions).t.min()
        assert near > 0.8 * CLEARANCE
        u, v = np.meshgrid(np.arange(80) + 0.5, np.arange(60) + 0.5)
        rays = np.stack([(u - 40) / camera.focal_px[0].item(), (v - 30) / camera.focal_px[1].item(), 1 + 0 * u], -1)
        hits = scene.closest_hit(np.broadcast_to(pose[:3, 3], (4800, 3)), rays.reshape(-1, 3) @ pose[:3, :3].T)
        seen += np.bincount(owner[hits.triangle], minlength=len(meshes)) >= 10
    assert seen.min() >= 8, seen
