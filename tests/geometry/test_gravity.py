"""Up and floor of rooms whose gravity is known, however they are turned, scaled and photographed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from boxrooms import FLOOR, WALL, cube, orbit, table
from goc.geometry.gravity import camera_up, find_gravity, find_up, level_plane

STEP = 0.04
UP = np.array([0.0, 0.0, 1.0])
TABLE, CUBE = table(0.0, 0.7), cube(0.15, 0.6, 0.72, 0.3)


def angle_deg(a, b):
    """Angle between two unit directions; exact for small ones too."""
    return float(np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(a - b) / 2, 0, 1))))


def rotation_about(axis, angle):
    return Rotation.from_rotvec(np.asarray(axis) * angle).as_matrix()


def surface(boxes, step=STEP):
    """Points on all sides of boxes, but for those that look down, and their normals."""
    points, normals = [], []
    for low, high in np.asarray(boxes, float):
        for axis in range(3):
            across = [np.arange(low[a] + step / 2, high[a], step) for a in range(3) if a != axis]
            grid = np.stack(np.meshgrid(*across, indexing="ij"), -1).reshape(-1, 2)
            for side, sign in ((low, -1.0), (high, 1.0)):
                if axis == 2 and sign < 0:
                    continue
                points.append(np.insert(grid, axis, side[axis], axis=1))
                normals.append(np.tile(sign * np.eye(3)[axis], (len(grid), 1)))
    return np.concatenate(points), np.concatenate(normals)


ROOM = surface([FLOOR, WALL, *TABLE, *CUBE])


def looking(positions, target, roll=0.0):
    """World from camera, each looking at the target, turned about its axis."""
    made = []
    for index, position in enumerate(positions):
        forward = np.asarray(target, float) - position
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, UP)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3] = np.stack([right, np.cross(forward, right), forward, position], 1)
        pose[:3, :3] = pose[:3, :3] @ rotation_about(UP, roll * (-1) ** index)
        made.append(pose)
    return np.stack(made)


TURNS = {
    "z up": np.eye(3),
    "y up": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "y down": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "tilted by 30 degrees": rotation_about(np.array([0.6, 0.8, 0.0]), np.radians(30)),
    "tilted by 100 degrees": rotation_about(np.array([0.0, 0.6, 0.8]), np.radians(100)),
}


def found(room=ROOM, poses=None, turn=TURNS["z up"], scale=1.0, up=None):
    """Gravity of a room that was turned and scaled."""
    poses = np.stack(orbit()) if poses is None else poses
    moved = np.tile(np.eye(4), (len(poses), 1, 1))
    moved[:, :3, :3], moved[:, :3, 3] = turn @ poses[:, :3, :3], scale * poses[:, :3, 3] @ turn.T
    rng = np.random.default_rng(0)
    return find_gravity(scale * room[0] @ turn.T, room[1] @ turn.T, scale * STEP, moved, rng, up)


@pytest.mark.parametrize("scale", [1.0, 3.0, 0.01])
@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_up_and_floor_of_a_room_turn_and_grow_with_it(turn, scale):
    gravity = found(turn=turn, scale=scale)
    assert angle_deg(gravity.up, turn @ UP) < 0.1
    assert np.linalg.norm(gravity.up) == pytest.approx(1.0, abs=1e-9)
    assert gravity.floor == pytest.approx(0.0, abs=0.005 * scale)
    assert gravity.is_level and gravity.confidence > 0.8


def test_an_axis_of_the_world_is_up_where_the_floor_nearly_says_so():
    almost = found(turn=rotation_about(np.array([1.0, 0, 0]), np.radians(0.6)))
    assert almost.up.tolist() == [0.0, 0.0, 1.0]
    clearly = found(turn=rotation_about(np.array([1.0, 0, 0]), np.radians(2.0)))
    assert angle_deg(clearly.up, UP) == pytest.approx(2.0, abs=0.1)


def test_noise_changes_little():
    rng = np.random.default_rng(1)
    points = ROOM[0] + 0.01 * rng.standard_normal(ROOM[0].shape)
    normals = ROOM[1] + 0.2 * rng.standard_normal(ROOM[1].shape)
    gravity = found((points, normals / np.linalg.norm(normals, axis=1, keepdims=True)))
    assert angle_deg(gravity.up, UP) < 0.5
    assert gravity.floor == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("pitch", [20.0, 32.0, 60.0])
def test_a_kitchen_seen_from_one_side_does_not_lean(pitch):
    """All cameras look one way and down, so their own up leans by as much; the floor does not."""
    distance = 2.2
    eye = np.array([0.0, -distance * np.cos(np.radians(pitch)), 0.4 + distance * np.sin(np.radians(pitch))])
    poses = looking([eye + [x, 0.0, 0.0] for x in np.linspace(-0.2, 0.2, 9)], (0.0, 0.0, 0.4))
    assert angle_deg(camera_up(poses), UP) == pytest.approx(pitch, abs=2)
    gravity = found(poses=poses)
    assert angle_deg(gravity.up, UP) < 0.1
    assert gravity.floor == pytest.approx(0.0, abs=0.005)
    assert gravity.confidence == pytest.approx(np.cos(np.radians(pitch)), abs=0.05)


def test_cameras_that_roll_do_not_turn_the_world():
    positions = np.stack(orbit())[:, :3, 3]
    gravity = found(poses=looking(positions, (0.0, 0.7, 0.35), roll=np.radians(25)))
    assert angle_deg(gravity.up, UP) < 0.1


def test_without_a_floor_the_lowest_point_is_one():
    """A table alone: its top tells up, its feet tell where it stands."""
    gravity = found(surface(TABLE, 0.01))
    assert gravity.is_level and angle_deg(gravity.up, UP) < 0.1
    assert gravity.floor == pytest.approx(0.0, abs=0.02)
    assert gravity.floor_confidence == 0.25
    assert gravity.confidence < found().confidence / 2


def test_a_table_top_alone_is_what_things_stand_on():
    gravity = found(surface([((-0.6, 0.3, 0.70), (0.6, 1.1, 0.72)), *CUBE], 0.01))
    assert angle_deg(gravity.up, UP) < 0.1
    assert gravity.floor == pytest.approx(0.72, abs=0.03)


def test_without_any_level_surface_cameras_tell_up():
    wall = surface([WALL])
    gravity = found((wall[0][wall[1][:, 2] < 0.5], wall[1][wall[1][:, 2] < 0.5]))
    assert not gravity.is_level
    assert angle_deg(gravity.up, UP) < 1.0  # these cameras are level
    assert gravity.floor == pytest.approx(-0.2, abs=0.05)
    assert gravity.confidence == pytest.approx(0.25**2)


def test_cameras_that_look_every_way_and_see_nothing_level_leave_z():
    poses = looking([[0.0, -2.0, 1.0]] * 2, (0.0, 0.0, 1.0))
    poses[1, :3, :2] *= -1.0  # on its head
    wall = surface([WALL])
    upright = wall[1][:, 2] < 0.5
    assert found((wall[0][upright], wall[1][upright]), poses).up.tolist() == [0.0, 0.0, 1.0]


def test_what_the_user_says_is_sure():
    lean = rotation_about(np.array([1.0, 0, 0]), np.radians(5)) @ UP
    gravity = found(up=lean)
    assert np.array_equal(gravity.up, lean) and gravity.up_confidence == 1.0 and gravity.is_level


def test_level_cameras_tell_up():
    assert camera_up(np.stack(orbit())) == pytest.approx([0, 0, 1], abs=1e-3)


def test_a_plane_with_cameras_below_it_is_no_floor():
    poses = np.stack(orbit())
    below = poses - np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 4.0], [0, 0, 0, 0]])
    rng = np.random.default_rng(0)
    assert level_plane(*ROOM, STEP, below, rng) is None
    up, is_level = find_up(*ROOM, STEP, below, rng)
    assert not is_level and angle_deg(up, UP) < 1.0
