import numpy as np
import pytest

from captures import BENT, unbend
from goc.capture.distortion import distort, kept_box, sampling_grid
from goc.capture.source import Lens

DIRECTIONS = np.stack(np.meshgrid(np.linspace(-0.6, 0.6, 9), np.linspace(-0.5, 0.5, 7)), -1)


def test_distorting_inverts_undistorting():
    """Twin: fixed-point inversion of the model, written separately."""
    lens = Lens(64, 48, (50.0, 51.0), (31.0, 24.5), radial=(0.1, -0.03, 0.01, -0.002), tangential=(0.004, -0.003))
    np.testing.assert_allclose(distort(lens, unbend(lens, DIRECTIONS)), DIRECTIONS, atol=1e-12)


def test_distortion_of_one_direction_by_hand():
    """At x = 0.5, y = 0: radial 1 + 0.1/4 + 0.2/16; tangential p2 (r² + 2x²) = 0.01·0.75 and p1 r² = 0.02·0.25."""
    lens = Lens(8, 8, (8.0, 8.0), (4.0, 4.0), radial=(0.1, 0.2, 0.0, 0.0), tangential=(0.02, 0.01))
    np.testing.assert_allclose(distort(lens, np.array([0.5, 0.0])), [0.5 * 1.0375 + 0.0075, 0.005])


def test_a_pinhole_keeps_everything():
    lens = Lens(64, 48, (50.0, 51.0), (31.0, 24.5))
    assert kept_box(lens) == (0, 0, 64, 48)
    grid = sampling_grid(lens)
    np.testing.assert_allclose(grid[0, 0], [1 / 64 - 1, 1 / 48 - 1], atol=1e-6)
    np.testing.assert_allclose(grid[-1, -1], [1 - 1 / 64, 1 - 1 / 48], atol=1e-6)


@pytest.mark.parametrize("k1", [0.3, 0.05, -0.05])
def test_every_kept_pixel_has_a_source(k1):
    lens = Lens(80, 60, (60.0, 60.0), (37.0, 33.0), radial=(k1, 0.0, 0.0, 0.0))
    grid = sampling_grid(lens)
    assert grid.abs().max() <= 1
    left, top, right, bottom = kept_box(lens)
    assert grid.shape == (bottom - top, right - left, 2)
    assert (right - left) * (bottom - top) > 0.5 * 80 * 60


def test_pixels_beyond_the_fold_are_cropped():
    """r (1 - r²/2) turns back at r² = 2/3: farther pixels would repeat nearer ones."""
    lens = Lens(100, 100, (50.0, 50.0), (50.0, 50.0), radial=(-0.5, 0.0, 0.0, 0.0))
    left, top, right, bottom = kept_box(lens)
    corner = np.array([left + 0.5 - 50, top + 0.5 - 50]) / 50
    assert corner @ corner < 2 / 3
    assert right - left > 50


def test_the_centre_of_the_lens_stays_where_it_is():
    left, top, _, _ = kept_box(BENT)
    grid = sampling_grid(BENT).numpy()
    source = (grid + 1) / 2 * [BENT.width, BENT.height]
    column, row = int(BENT.centre_px[0]) - left, int(BENT.centre_px[1]) - top
    np.testing.assert_allclose(source[row, column], [column + left + 0.5, row + top + 0.5], atol=0.01)
