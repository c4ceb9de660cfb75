"""What cameras leave of a mesh, in closed form."""

import numpy as np
import pytest

from assets import box_mesh
from cameras import pinhole, placed
from goc.evaluation.culling import RefusionConfig, cull_to_frustums, fuse_renders
from goc.evaluation.protocols.phyrecon import voxel_means
from goc.scene import Mesh
from solids import cuboid, joined


def camera(at=(0.0, 0.0, 0.0)):
    """Looks along +z from `at`."""
    return pinhole(64.0, (64, 64), pose=placed(at))


def board(depth, half=0.5):
    """A square that faces a camera at the origin."""
    corners = [(-half, -half, depth), (-half, half, depth), (half, half, depth), (half, -half, depth)]
    return Mesh(vertices=np.array(corners, np.float32), faces=np.array([(0, 1, 2), (0, 2, 3)], np.int32))


def test_a_square_is_fused_where_it_stands():
    found = fuse_renders(board(1.503), (camera(),), RefusionConfig())
    np.testing.assert_allclose(found.vertices[:, 2], 1.503, atol=1e-4)
    assert np.abs(found.vertices[:, :2]).max() == pytest.approx(0.5, abs=0.02)
    assert len(found.vertices) == pytest.approx(100 * 100, rel=0.1)  # a vertex each centimetre


def test_what_is_hidden_turned_away_or_too_far_is_not_there():
    hidden = fuse_renders(joined(board(1.0, 0.6), board(1.5)), (camera(),), RefusionConfig())
    np.testing.assert_allclose(hidden.vertices[:, 2], 1.0, atol=1e-4)
    away = Mesh(vertices=board(1.0).vertices, faces=np.ascontiguousarray(board(1.0).faces[:, ::-1]))
    assert len(fuse_renders(away, (camera(),), RefusionConfig()).faces) == 0
    through = fuse_renders(joined(away, board(1.5)), (camera(),), RefusionConfig())
    np.testing.assert_allclose(through.vertices[:, 2], 1.5, atol=1e-4)
    assert len(fuse_renders(board(5.2), (camera(),), RefusionConfig()).faces) == 0
    assert len(fuse_renders(board(-1.0), (camera(),), RefusionConfig()).faces) == 0
    assert len(fuse_renders(board(1.0), (), RefusionConfig()).faces) == 0


def test_large_volumes_are_fused_in_parts_with_the_same_result(monkeypatch):
    cameras = (camera(), camera((0.2, 0.1, 0.0)))
    whole = fuse_renders(board(1.203), cameras, RefusionConfig())
    monkeypatch.setattr("goc.evaluation.culling._CHUNK_BLOCKS", 7)
    parts = fuse_renders(board(1.203), cameras, RefusionConfig())
    np.testing.assert_array_equal(whole.vertices, parts.vertices)
    np.testing.assert_array_equal(whole.faces, parts.faces)


def test_faces_outside_all_frustums_are_dropped_and_hidden_ones_kept():
    boards = joined(board(1.0), board(2.0), Mesh(vertices=board(1.0).vertices + 10, faces=board(1.0).faces))
    assert len(cull_to_frustums(boards, (camera(),)).faces) == 4
    assert len(cull_to_frustums(boards, (camera((10.0, 10.0, 10.0)),)).faces) == 2
    assert len(cull_to_frustums(box_mesh(np.array([[-1, -1, -3.0], [1, 1, -2]])), (camera(),)).faces) == 0
    assert len(cull_to_frustums(cuboid((-0.1, -0.1, 1), (0.1, 0.1, 1.2)), ()).faces) == 0


def test_voxel_means():
    points = np.array([[0.0, 0, 0], [0.004, 0, 0], [0.5, 0.5, 0.5]])
    np.testing.assert_allclose(voxel_means(points, 0.02), [[0.002, 0, 0], [0.5, 0.5, 0.5]])
    assert len(voxel_means(np.zeros((0, 3)), 0.02)) == 0
