"""Laws of the camera: projecting and unprojecting undo each other, in every pose, raster and dtype."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from cameras import pinhole, random_poses
from goc.scene import Camera


def rigid(seed: int) -> torch.Tensor:
    """A random pose, float64."""
    return torch.from_numpy(random_poses(1, seed, reach=6.0)[0])


def camera(seed: int = 0) -> Camera:
    random = np.random.default_rng(seed)
    return pinhole(random.uniform(20, 100, 2), (64, 48), random.uniform(10, 50, 2), rigid(seed))


def places(seed: int, count: int = 50) -> tuple[torch.Tensor, torch.Tensor]:
    """Pixel coordinates, some out of the frame, and z; float64."""
    random = torch.Generator().manual_seed(seed + 1000)
    pixels = torch.rand(count, 2, dtype=torch.float64, generator=random) * 120 - 30
    return pixels, 0.1 + 10 * torch.rand(count, dtype=torch.float64, generator=random)


@given(st.integers(0, 10_000))
def test_project_undoes_unproject(seed):
    pixels, z = places(seed)
    found, depth = camera(seed).project(camera(seed).unproject(pixels, z))
    torch.testing.assert_close(found, pixels, rtol=0, atol=2e-3)  # the pose itself is rounded to float32
    torch.testing.assert_close(depth, z, rtol=0, atol=1e-5)


@given(st.integers(0, 10_000))
def test_in_double_they_undo_each_other_to_the_last_digits(seed):
    exact = replace(camera(seed).double(), world_from_cam=rigid(seed))
    pixels, z = places(seed)
    points = exact.unproject(pixels, z)
    found, depth = exact.project(points)
    torch.testing.assert_close(found, pixels, rtol=0, atol=1e-9)
    torch.testing.assert_close(depth, z, rtol=0, atol=1e-12)
    torch.testing.assert_close(exact.unproject(found, depth), points, rtol=0, atol=1e-11)
    torch.testing.assert_close(exact.in_world(exact.in_camera(points)), points, rtol=0, atol=1e-12)


def test_a_depth_image_is_unprojected_at_pixel_centres():
    view = camera(3)
    depth = 1.0 + torch.rand(48, 64)
    pixels, z = view.project(view.unproject_depth(depth))
    rows, columns = torch.meshgrid(torch.arange(48), torch.arange(64), indexing="ij")
    torch.testing.assert_close(pixels, torch.stack([columns, rows], -1) + 0.5, rtol=0, atol=2e-3)
    torch.testing.assert_close(z, depth, rtol=0, atol=1e-5)
    torch.testing.assert_close(
        view.unproject_depth(depth), view.unproject(torch.stack([columns, rows], -1) + 0.5, depth)
    )


def test_rays_have_depth_one_and_the_axis_goes_through_the_centre():
    view = replace(camera(4), centre_px=torch.tensor([10.5, 7.5]))
    rays = view.rays()
    assert rays.shape == (48, 64, 3) and (rays[..., 2] == 1).all()
    assert torch.equal(rays[7, 10], torch.tensor([0.0, 0.0, 1.0]))
    torch.testing.assert_close(rays[7, 11, 0], 1 / view.focal_px[0])
    assert torch.equal(view.rays_through(torch.tensor([[0.5, 0.5], [63.5, 47.5]])), rays[[0, 47], [0, 63]])


@given(st.integers(0, 10_000))
def test_moving_camera_and_points_together_changes_no_pixel(seed):
    """Equivariance: project of M·camera at M·points is project."""
    still, move = camera(seed).double(), rigid(seed + 1)
    points = still.unproject(*places(seed))
    moved = replace(still, world_from_cam=move @ still.world_from_cam)
    before, after = still.project(points), moved.project(points @ move[:3, :3].T + move[:3, 3])
    torch.testing.assert_close(after[0], before[0], rtol=0, atol=1e-4)  # the pose is as rigid as float32 makes it
    torch.testing.assert_close(after[1], before[1], rtol=0, atol=1e-5)


@pytest.mark.parametrize("size", [(32, 24), (96, 72), (64, 24)])
def test_resizing_scales_pixels_and_keeps_depth(size):
    view = camera(5)
    points = view.unproject(*places(5))
    scale = torch.tensor([size[0] / 64, size[1] / 48])
    (pixels, z), (small, same) = view.project(points), view.resized(*size).project(points)
    torch.testing.assert_close(small, pixels * scale, rtol=0, atol=1e-9 + 1e-4)
    assert torch.equal(same, z)


def test_what_is_not_before_the_camera_has_no_pixel():
    view = camera(6)
    local = torch.tensor([[0.1, 0.2, -1.0], [0.1, 0.2, 0.0], [0.0, 0.0, 1.0]])
    view = replace(view, world_from_cam=torch.eye(4))
    pixels, z = view.project(local)
    assert torch.isnan(pixels[:2]).all() and torch.equal(z, local[:, 2])
    assert torch.equal(pixels[2], view.centre_px)
    assert view.sees(local).tolist() == [False, False, True]


def test_no_depth_is_no_point():
    view = camera(7)
    depth = torch.full((48, 64), 2.0)
    depth[3, 5] = torch.nan
    missing = torch.isnan(view.unproject_depth(depth))
    assert missing[3, 5].all() and missing.sum() == 3


def test_a_camera_sees_its_frame_and_its_border():
    view = camera(8)
    pixels = torch.tensor([[0.5, 0.5], [63.5, 47.5], [-0.1, 5.0], [5.0, 48.1]])
    assert view.sees(view.unproject(pixels, torch.full((4,), 3.0))).tolist() == [True, True, False, False]
    plain = replace(view, world_from_cam=torch.eye(4), focal_px=torch.ones(2), centre_px=torch.zeros(2))
    assert plain.sees(torch.tensor([[0.0, 0.0, 1.0], [64.0, 48.0, 1.0]])).all()


def test_the_wider_dtype_is_kept():
    view, points = camera(9), torch.randn(5, 3)
    for who, given_points, dtype in (
        (view, points, torch.float32),
        (view, points.double(), torch.float64),
        (view.double(), points, torch.float64),
    ):
        assert [found.dtype for found in who.project(given_points)] == [dtype, dtype]
        assert who.unproject(given_points[:, :2], given_points[:, 2]).dtype == dtype
        assert who.in_camera(given_points).dtype == who.in_world(given_points).dtype == dtype
    assert view.double().rays().dtype == view.double().cam_from_world.dtype == torch.float64


def test_a_camera_that_is_there_already_is_itself():
    view = camera(10)
    assert view.to(torch.device("cpu")) is view and view.to(dtype=torch.float32) is view
    assert torch.equal(view.double().world_from_cam.float(), view.world_from_cam)


def test_gradients_reach_points_through_the_projection():
    view = camera(11).double()
    points = view.unproject(*(part[:4] for part in places(11))).requires_grad_()
    assert torch.autograd.gradcheck(view.project, points)
