import numpy as np
import pytest

from goc import _native
from goc.synth.noise import _lattice, cell_random, fractal_noise, value_noise
from oracles import noise as oracle

POINTS = np.random.default_rng(0).uniform(-100, 100, (500, 3))


@pytest.mark.parametrize("octaves", [1, 3])
def test_noise_equals_its_twin(octaves):
    expected = oracle.fractal_noise(POINTS, _lattice().astype(np.float64), octaves)
    np.testing.assert_allclose(fractal_noise(POINTS, octaves), expected, atol=2e-5)  # float32 against float64


def test_noise_is_the_lattice_at_integers_smooth_between_and_periodic():
    whole = np.floor(POINTS)
    np.testing.assert_array_equal(value_noise(whole), cell_random(whole))
    np.testing.assert_allclose(value_noise(POINTS + 64), value_noise(POINTS), atol=1e-5)
    assert np.abs(value_noise(POINTS + 1e-4) - value_noise(POINTS)).max() < 1e-3


def test_the_binding_refuses_points_that_have_no_cell():
    lattice, out = _lattice(), np.zeros(1, np.float32)
    for bad in (np.nan, np.inf, 1e13):
        with pytest.raises(ValueError, match="not finite or too far"):
            _native.fractal_noise(np.full((1, 3), bad), lattice, 1, out)
    with pytest.raises(ValueError, match="octaves"):
        _native.fractal_noise(np.zeros((1, 3)), lattice, 0, out)
    with pytest.raises(ValueError, match="different lengths"):
        _native.fractal_noise(np.zeros((2, 3)), lattice, 1, out)
