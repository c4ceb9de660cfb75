"""A field asked at every voxel: the slow twin of `goc.complete.decode`."""

import numpy as np
import torch

BEYOND = -20.0
"""Log-odds outside of the field's cube [-1, 1]."""


def decode_densely(field, grid):
    """Log-odds (x y z) at every voxel of a grid."""
    index = np.moveaxis(np.indices(grid.shape), 0, -1)
    points = (grid.origin + grid.voxel * index).astype(np.float32).reshape(-1, 3)
    within = (np.abs(points) <= 1.0).all(axis=1)
    values = np.full(len(points), BEYOND, np.float32)
    values[within] = field.logits(torch.from_numpy(points[within])).detach().float().cpu().numpy()
    return values.reshape(grid.shape)
