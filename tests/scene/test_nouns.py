"""Laws of the nouns: inverse poses, resizing, selecting."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
import torch

from cameras import pinhole, turned
from goc.scene import Capture, FlaggedMesh, Frame, Gaussians, Mesh, SceneObject, World

VIEW = pinhole((50.0, 52.0), (64, 48), (30.0, 22.0), turned((0.3, -0.5, 0.7, 0.2), (1.0, -2.0, 0.5)))


def splats(count: int) -> Gaussians:
    return Gaussians(
        means=torch.randn(count, 3),
        quats=torch.randn(count, 4),
        log_scales=torch.randn(count, 3),
        opacity_logits=torch.randn(count),
        sh=torch.randn(count, 9, 3),
        identity=torch.randn(count, 5),
    )


def test_poses_undo_each_other():
    view = VIEW
    assert torch.allclose(view.cam_from_world @ view.world_from_cam, torch.eye(4), atol=1e-6)
    assert torch.allclose(
        view.cam_from_world[:3, :3] @ view.position + view.cam_from_world[:3, 3], torch.zeros(3), atol=1e-6
    )


def test_a_resized_view_has_the_same_field():
    view, small = VIEW, VIEW.resized(32, 24)
    # Corners of the raster, not pixel centres, are what stays.
    for side in (view, small):
        left = (0.0 - side.centre_px) / side.focal_px
        right = (torch.tensor([side.width, side.height]) - side.centre_px) / side.focal_px
        assert torch.allclose(left, torch.tensor([-0.6, -22 / 52]))
        assert torch.allclose(right, torch.tensor([0.68, 0.5]))
    assert torch.allclose(small.rays()[3, 5], view.rays()[6:8, 10:12].mean((0, 1)), atol=1e-6)


def test_nouns_do_not_change():
    with pytest.raises(FrozenInstanceError):
        VIEW.width = 3


def test_selected_splats_keep_their_rows_together():
    all_splats = splats(6)
    chosen = all_splats[torch.tensor([4, 1])]
    assert len(chosen) == 2 and chosen.sh_degree == 2
    assert torch.equal(chosen.means, all_splats.means[[4, 1]])
    assert torch.equal(chosen.identity, all_splats.identity[[4, 1]])
    plain = replace(all_splats, identity=None)[all_splats.opacity_logits > 0]
    assert plain.identity is None and len(plain) == int((all_splats.opacity_logits > 0).sum())


def test_detached_splats_leave_the_graph():
    tracked = replace(splats(3), means=torch.randn(3, 3, requires_grad=True))
    assert not tracked.detached().means.requires_grad


def test_a_capture_loads_views_when_asked():
    asked = []

    def load(index: int) -> Frame:
        asked.append(index)
        return Frame(camera=VIEW, image=torch.zeros(48, 64, 3, dtype=torch.uint8))

    capture = Capture(cameras=(VIEW,) * 3, view_names=("a", "b", "c"), frames=load, has_depth=False, has_ids=False)
    assert len(capture) == 3 and asked == []
    assert capture[1].depth is None and asked == [1]
    assert sum(1 for _ in capture) == 3 and asked == [1, 0, 1, 2]
    assert capture[-1].image.shape == (48, 64, 3) and asked[-1] == 2
    for index in (3, -4):
        with pytest.raises(IndexError):
            capture[index]


@pytest.mark.parametrize("seed", range(6))
def test_the_frame_of_exports_is_right_handed_level_and_in_metres(seed):
    random = np.random.default_rng(seed)
    up = random.normal(size=3) if seed else np.array([1.0, 0, 0])
    up /= np.linalg.norm(up)
    unit, floor = 10.0 ** random.uniform(-2, 2), random.normal()
    matrix = World(up=up, floor=floor, confidence=1.0, units_per_metre=unit, metric=True).level_from_world
    turn = matrix[:3, :3] * unit
    assert np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) == pytest.approx(1.0)
    assert turn @ up == pytest.approx([0, 0, 1])
    on_floor = floor * up + np.cross(up, random.normal(size=3))
    assert (matrix[:3, :3] @ on_floor + matrix[:3, 3])[2] == pytest.approx(0.0, abs=1e-9 + 1e-9 / unit)
    assert matrix[3].tolist() == [0, 0, 0, 1]


def test_a_world_with_z_up_is_not_turned():
    world = World(up=np.array([0.0, 0, 1]), floor=0.5, confidence=1.0, units_per_metre=2.0, metric=True)
    assert np.array_equal(world.level_from_world[:3, :3], np.eye(3) / 2) and world.level_from_world[2, 3] == -0.25


def test_the_surface_of_an_object_is_the_closed_one_where_there_is_one():
    mesh = Mesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    seen, closed = (FlaggedMesh(mesh=mesh, observed=np.zeros(0, bool)) for _ in range(2))
    bare = SceneObject(id=1, name="cup")
    assert bare.surface is None and np.array_equal(bare.world_from_object, np.eye(4))
    assert replace(bare, observed=seen).surface is seen
    assert replace(bare, observed=seen, solid=closed).surface is closed
