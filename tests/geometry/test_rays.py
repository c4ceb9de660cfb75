"""Rays through pixels are where `Camera.project` puts their points."""

import numpy as np
import torch

from cameras import pinhole, turned
from goc.geometry.raycast import TriangleScene
from goc.geometry.rays import world_rays

CAMERA = pinhole((30.0, 28.0), (20, 14), (9.0, 7.5), turned((0.9, -0.1, 0.3, 0.2), (0.4, -1.0, 0.2)))


def test_rays_of_all_pixels_run_row_by_row_and_count_depth():
    origins, directions = world_rays(CAMERA)
    pixels, z = CAMERA.project(torch.from_numpy(origins + 2.5 * directions))
    row, column = np.divmod(np.arange(20 * 14), 20)
    assert directions.dtype == np.float64
    np.testing.assert_allclose(z, 2.5, atol=1e-6)
    np.testing.assert_allclose(pixels, np.stack([column, row], -1) + 0.5, atol=1e-4)


def test_rays_of_chosen_pixels_are_those_of_all():
    chosen = np.array([[3.5, 2.5], [19.5, 13.5], [0.5, 0.5]])
    _, directions = world_rays(CAMERA, chosen)
    np.testing.assert_allclose(directions, world_rays(CAMERA)[1][[2 * 20 + 3, 13 * 20 + 19, 0]], atol=1e-12)


def test_what_a_ray_meets_lies_at_its_depth():
    """Closed form: a wall across the optical axis at z = 3."""
    corners = torch.tensor([[-20.0, -20, 3], [20, -20, 3], [20, 20, 3], [-20, 20, 3]])
    vertices = CAMERA.in_world(corners).numpy()
    scene = TriangleScene(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    np.testing.assert_allclose(scene.closest_hit(*world_rays(CAMERA)).t, 3.0, atol=1e-5)
