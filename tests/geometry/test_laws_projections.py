"""Cameras: pixels, rays, poses and rasters agree, for lenses and poses of every kind."""

from dataclasses import replace

import numpy as np
import torch

from goc.geometry.normals import fitted_normals, normals_from_depth
from goc.scene import Camera
from laws import CAMERAS, MOTIONS, SCALES, close, only, over


def landed(camera: Camera, points: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Pixels and z of world points, written out on their own in float64."""
    pose = camera.world_from_cam.double().numpy()
    local = (points.double().numpy() - pose[:3, 3]) @ pose[:3, :3]
    return local[..., :2] / local[..., 2:] * camera.focal_px.numpy() + camera.centre_px.numpy(), local[..., 2]


def centres(camera: Camera) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), -1)


def depths(camera: Camera, scale=1.0, seed=0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return scale * (0.5 + 3 * torch.rand(camera.height, camera.width, generator=generator))


def scaled(camera: Camera, scale: float) -> Camera:
    pose = camera.world_from_cam.clone()
    pose[:3, 3] *= scale
    return replace(camera, world_from_cam=pose)


@over(camera=CAMERAS, scale=SCALES)
def test_a_pixel_with_depth_is_seen_where_it_was(camera, scale):
    here, depth = scaled(camera, scale), depths(camera, scale)
    pixels, z = landed(here, here.unproject_depth(depth))
    reach = float(here.position.abs().max()) + 10 * scale  # float32 positions round by their distance from the origin
    blur = reach * 2.0**-22 / float(depth.min()) * float(camera.focal_px.max()) + 1e-3
    np.testing.assert_allclose(pixels, centres(camera), atol=blur + 1e-6 * np.abs(centres(camera)).max())
    close(z, depth, size=reach)


@over(camera=CAMERAS)
def test_rays_pass_through_pixel_centres(camera):
    rays = camera.rays()
    assert rays.shape == (camera.height, camera.width, 3) and (rays[..., 2] == 1).all()
    pixels = rays[..., :2] * camera.focal_px + camera.centre_px
    close(pixels, centres(camera).astype(np.float32), size=float(camera.centre_px.abs().max()) + 100)


@over(camera=CAMERAS)
def test_poses_undo_each_other(camera):
    size = max(1.0, float(camera.position.abs().max()))
    close(camera.cam_from_world @ camera.world_from_cam, torch.eye(4), size=size)
    close(camera.world_from_cam @ camera.cam_from_world, torch.eye(4), size=size)
    close(camera.cam_from_world[:3, :3] @ camera.position + camera.cam_from_world[:3, 3], torch.zeros(3), size=size)


@over(camera=CAMERAS)
def test_another_raster_sees_the_same_field(camera):
    double = camera.resized(2 * camera.width, 2 * camera.height)
    fine = double.rays().reshape(camera.height, 2, camera.width, 2, 3).mean((1, 3))  # centres of four
    close(fine, camera.rays(), size=float(double.rays().abs().max()) + 1)
    back = double.resized(camera.width, camera.height)
    assert torch.equal(back.focal_px, camera.focal_px) and torch.equal(back.centre_px, camera.centre_px)
    assert (back.width, back.height) == (camera.width, camera.height)


@over(camera=CAMERAS, motion=MOTIONS)
def test_a_moved_camera_sees_moved_points(camera, motion):
    pose = motion @ camera.world_from_cam.double().numpy()
    elsewhere = replace(camera, world_from_cam=torch.from_numpy(pose).float())
    depth = depths(camera)
    points = camera.unproject_depth(depth).double().numpy() @ motion[:3, :3].T + motion[:3, 3]
    size = float(np.abs(points).max() + camera.position.abs().max()) + 1
    close(elsewhere.unproject_depth(depth), points.astype(np.float32), size=size)


@over(camera=CAMERAS)
def test_holes_of_depth_are_holes_of_points_and_nothing_else_is(camera):
    depth = depths(camera)
    depth.view(-1)[::3] = torch.nan
    points = camera.unproject_depth(depth)
    assert torch.equal(torch.isnan(points).all(-1), torch.isnan(depth))
    assert torch.equal(torch.isnan(points).any(-1), torch.isnan(depth))


def slanted(camera: Camera, scale: float) -> tuple[torch.Tensor, torch.Tensor]:
    """z of a plane before the camera, and its unit normal towards the camera, camera axes."""
    normal = torch.nn.functional.normalize(torch.tensor([0.2, -0.1, -1.0]), dim=0)
    return -scale / (camera.rays() @ normal), normal


@over(camera=only(CAMERAS, "plain", "crooked", "wide"), scale=SCALES)
def test_normals_do_not_depend_on_the_unit(camera, scale):
    depth, normal = slanted(camera, scale)
    front = depth > 0
    for normals in (normals_from_depth(depth, camera), fitted_normals(depth, camera, 2)):
        known = torch.isfinite(normals).all(-1) & front
        assert known[3:-3, 3:-3].float().mean() > 0.9
        close(normals[known].norm(dim=-1), torch.ones(int(known.sum())), ulps=32)
        # differences of float32 depths: their rounding over the pitch of a pixel
        assert (normals[known] @ normal).min() > 1 - 1e-4


@over(camera=CAMERAS)
def test_normals_face_the_camera_whatever_the_surface(camera):
    depth = depths(camera, seed=3)
    normals = normals_from_depth(depth, camera) if min(depth.shape) > 2 else fitted_normals(depth, camera, 1)
    known = torch.isfinite(normals).all(-1)
    assert ((normals * camera.rays()).sum(-1)[known] <= 1e-5).all()
