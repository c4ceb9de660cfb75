"""Neighbours of views: closed form, and laws."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from cameras import pinhole, placed
from goc.geometry.neighbours import PairLimits, neighbour_views
from goc.scene import Camera

LIMITS = PairLimits(max_angle_deg=30.0, min_baseline=0.1, max_baseline=1.0, depths=(1.0, 2.0, 4.0))


def camera(x: float = 0.0, yaw_deg: float = 0.0, z: float = 0.0) -> Camera:
    """A camera at (x, 0, z) that looks along z, turned about y; 90° wide."""
    return pinhole(50.0, (100, 80), pose=placed((x, 0.0, z), math.radians(yaw_deg)))


def test_the_most_alike_in_direction_come_first():
    cameras = [camera(), camera(0.3, 20.0), camera(0.5, 5.0), camera(-0.4, -10.0), camera(0.2, 5.0)]
    found = neighbour_views(cameras, range(5), 3, LIMITS)
    assert found[0] == (4, 2, 3)  # 5° at 0.2 m, 5° at 0.5 m, 10°


@pytest.mark.parametrize(
    ("other", "pairs"),
    [
        (camera(0.3), True),
        (camera(0.09), False),  # no parallax
        (camera(1.01), False),
        (camera(0.3, 29.9), True),
        (camera(0.3, 30.1), False),
        (camera(0.3, 180.0), False),  # looks the other way
    ],
)
def test_limits_of_angle_and_baseline(other, pairs):
    assert neighbour_views([camera(), other], [0, 1], 4, LIMITS)[0] == ((1,) if pairs else ())


def test_frusta_must_overlap():
    """At depth d a camera 90° wide sees 2·d across: one that stands b to the side sees 1 - b / 2·d of it."""
    near = replace(LIMITS, depths=(0.5,), max_baseline=3.0)
    for baseline, pairs in ((0.5, True), (0.8, False)):
        assert bool(neighbour_views([camera(), camera(baseline)], [0, 1], 4, near)[0]) == pairs
    # looking the same way, but from before the surface to behind it
    assert neighbour_views([camera(), camera(z=0.9)], [0, 1], 4, near)[0] == ()


def test_a_roll_about_the_optical_axis_changes_nothing():
    rolled = camera(0.3)
    pose = rolled.world_from_cam.clone()
    pose[:3, 0], pose[:3, 1] = rolled.world_from_cam[:3, 1], -rolled.world_from_cam[:3, 0]
    assert neighbour_views([camera(), replace(rolled, world_from_cam=pose)], [0, 1], 4, LIMITS)[0] == (1,)


def test_only_the_given_views_take_part():
    cameras = [camera(0.2 * i) for i in range(6)]
    found = neighbour_views(cameras, [1, 3, 4], 2, LIMITS)
    assert found == {1: (3, 4), 3: (4, 1), 4: (3, 1)}
    assert neighbour_views(cameras, [2], 4, LIMITS) == {2: ()}


def test_a_rigid_motion_and_a_change_of_unit_change_nothing():
    rng = np.random.default_rng(0)
    cameras = [camera(rng.uniform(-1, 1), rng.uniform(-60, 60), rng.uniform(-0.5, 0.5)) for _ in range(20)]
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))

    def moved(view: Camera) -> Camera:
        pose = view.world_from_cam.clone()
        pose[:3, :3] = torch.tensor(rotation, dtype=torch.float32) @ pose[:3, :3]
        pose[:3, 3] = 2.5 * (torch.tensor(rotation, dtype=torch.float32) @ pose[:3, 3] + torch.tensor([3.0, -1.0, 2.0]))
        return replace(view, world_from_cam=pose)

    scaled = replace(LIMITS, min_baseline=0.25, max_baseline=2.5, depths=tuple(2.5 * depth for depth in LIMITS.depths))
    first = neighbour_views(cameras, range(20), 4, LIMITS)
    assert first == neighbour_views([moved(view) for view in cameras], range(20), 4, scaled)
    assert sum(map(len, first.values())) > 10
