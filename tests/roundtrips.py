"""Comparison of what another format makes of a room with what the native layout does."""

import numpy as np

from goc.scene import Capture


def assert_same_cameras(made: Capture, truth: Capture, turn: np.ndarray | None = None) -> None:
    """Equal to 1e-4 rad and 1e-4 m, in the same order, after turning the truth's world."""
    assert len(made) == len(truth)
    for mine, other in zip(made.cameras, truth.cameras, strict=True):
        assert (mine.width, mine.height) == (other.width, other.height)
        np.testing.assert_allclose(mine.focal_px, other.focal_px, rtol=1e-5)
        np.testing.assert_allclose(mine.centre_px, other.centre_px, atol=1e-3)
        pose = other.world_from_cam.double().numpy()
        pose = pose if turn is None else turn @ pose
        found = mine.world_from_cam.double().numpy()
        between = pose[:3, :3].T @ found[:3, :3]
        sine = np.linalg.norm(between - between.T) / np.sqrt(8)
        assert np.trace(between) > 2.9 and sine < 1e-4
        np.testing.assert_allclose(found[:3, 3], pose[:3, 3], atol=1e-4)


def assert_same_frames(made: Capture, truth: Capture, *, depth: bool = True, ids: bool = True, lossy: int = 3) -> None:
    """Colours to what JPEG leaves, depth to a millimetre and in the same places, ids exactly."""
    assert (made.has_depth, made.has_ids) == (depth, ids)
    for mine, other in zip(made, truth, strict=True):
        assert np.median(np.abs(mine.image.numpy().astype(int) - other.image.numpy())) <= lossy
        if depth:
            np.testing.assert_allclose(mine.depth, other.depth, atol=1e-3)  # NaN in the same places
        if ids:
            np.testing.assert_array_equal(mine.ids, other.ids)
