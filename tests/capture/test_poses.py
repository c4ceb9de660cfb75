import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cameras import ring
from captures import poses
from goc.capture.poses import PoseError, rigid
from goc.capture.scale import guess_units_per_metre


def test_a_rounded_rotation_becomes_exact():
    pose = poses()[1]
    exact = rigid(np.round(pose, 3))
    np.testing.assert_allclose(exact[:3, :3].T @ exact[:3, :3], np.eye(3), atol=1e-14)
    np.testing.assert_allclose(exact, pose, atol=2e-3)
    np.testing.assert_array_equal(rigid(pose[:3])[3], [0, 0, 0, 1])


@given(st.lists(st.lists(st.floats(), max_size=5), max_size=5))
def test_any_numbers_give_a_pose_or_a_pose_error(rows):
    try:
        pose = rigid(rows)
    except PoseError:
        return
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("scale", [0.1, 1.0, 25.0])
def test_a_circle_round_an_object_counts_as_two_metres(scale):
    poses = ring(np.linspace(0, 5, 12), 2 * scale)
    for pose in poses:
        pose[:3, 3] += (7, 8, 9)
    assert guess_units_per_metre(poses) == pytest.approx(scale)


def test_parallel_axes_fall_back_to_the_length_of_the_path():
    row = [np.eye(4) for _ in range(5)]
    for number, pose in enumerate(row):
        pose[0, 3] = number
    assert guess_units_per_metre(row) == pytest.approx(2.0)  # a path of four units counts as 2 m


def test_a_panorama_from_one_spot_has_no_scale():
    assert guess_units_per_metre([pose * [[1, 1, 1, 0]] * 3 + np.eye(4) * [0, 0, 0, 1] for pose in poses()]) == 1.0
    assert guess_units_per_metre([np.eye(4)]) == 1.0
