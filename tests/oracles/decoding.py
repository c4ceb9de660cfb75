"""A field asked at every voxel: the slow twin of `goc.complete.decode`."""

import numpy as np
import torch

BEYOND = -20.0
"""Log-odds outside of the field's cube [-1, 1]."""


def decode_densely(field, lattice):
    """Log-odds (x y z) at every voxel of a lattice."""
    index = np.moveaxis(np.indices(lattice.shape), 0, -1)
    points = (lattice.origin + lattice.voxel * index).astype(np.float32).reshape(-1, 3)
    within = (np.abs(points) <= 1.0).all(axis=1)
    values = np.full(len(points), BEYOND, np.float32)
    values[within] = field.logits(torch.from_numpy(points[within])).detach().float().cpu().numpy()
    return values.reshape(lattice.shape)
