"""Value noise written out with numpy: the obvious twin of native/noise.cpp."""

import numpy as np


def fractal_noise(points, lattice, octaves):
    total, weights = np.zeros(len(points)), 0.0
    for octave in range(octaves):
        at = points * 2.0**octave + 17.3 * octave
        floor = np.floor(at)
        t = at - floor
        smooth = t * t * (3 - 2 * t)
        value = np.zeros(len(points))
        for corner in np.ndindex(2, 2, 2):
            index = (floor.astype(int) + corner) % len(lattice)
            weight = np.where(corner, smooth, 1 - smooth).prod(-1)
            value += weight * lattice[tuple(index.T)]
        total += value * 0.5**octave
        weights += 0.5**octave
    return total / weights
