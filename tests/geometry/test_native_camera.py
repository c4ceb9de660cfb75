"""What the kernels' camera is made of, and what it refuses."""

import numpy as np
import pytest

from cameras import pinhole, turned
from goc import _native
from goc.geometry.native_camera import native_camera
from goc.geometry.normals import fitted_normals
from goc.geometry.rays import world_rays

CAMERA = pinhole((30.0, 28.0), (20, 14), (9.0, 7.5), turned((0.9, -0.1, 0.3, 0.2), (0.4, -1.0, 0.2)))


@pytest.mark.parametrize("camera", [CAMERA, CAMERA.double()])
def test_kernels_see_cells_where_the_camera_unprojects(camera):
    """Twin: cells of the pixels' points, found by either."""
    depth = np.linspace(1.0, 3.0, 20 * 14, dtype=np.float32).reshape(14, 20)
    keys, hits = _native.count_cells(depth, np.ones_like(depth), None, native_camera(camera), 0.25)
    cells = (keys.astype(np.uint64) >> np.array([32, 16, 0], np.uint64) & np.uint64(0xFFFF)).astype(int) - 32768
    origins, directions = world_rays(camera)
    points = origins + depth.reshape(-1, 1) * directions
    expected, counts = np.unique(np.floor(points / 0.25).astype(int), axis=0, return_counts=True)
    np.testing.assert_array_equal(cells, expected)
    np.testing.assert_array_equal(hits[:, 0], counts)


@pytest.mark.parametrize(
    ("focal", "size", "said"),
    [((0.0, 1.0), (4, 3), "focal lengths must be positive"), ((1.0, 1.0), (0, 3), "must have a width and a height")],
)
def test_what_is_no_camera_is_refused(focal, size, said):
    rows = np.eye(4)[:3].tolist()
    with pytest.raises(ValueError, match=said):
        _native.Camera(focal, (0.0, 0.0), *size, rows, rows)


def test_an_image_of_another_size_is_refused():
    depth = CAMERA.rays()[..., 2]
    with pytest.raises(ValueError, match="depth must have the camera's height and width"):
        fitted_normals(depth[1:], CAMERA, 1)
