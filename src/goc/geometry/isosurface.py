"""The surface of a signed distance on a dense grid."""

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32

from goc import _native

_BLOCK = 8


def grid_surface(
    values: Float[np.ndarray, "x y z"], origin: Float[np.ndarray, "3"] | Float64[np.ndarray, "3"], voxel: float
) -> tuple[Float32[np.ndarray, "v 3"], Int32[np.ndarray, "t 3"]]:
    """Zero level by marching cubes, counter-clockwise from the positive side, closed also where the grid ends.

    Args:
        values: at origin + voxel · (i, j, k), negative inside.
        origin: position of values[0, 0, 0].
        voxel: edge of a cell.

    Returns:
        Vertices and faces, one vertex a crossed edge of the grid.
    """
    shape = np.array(values.shape) + 2
    blocks = -(-shape // _BLOCK)
    outside = np.float32(voxel)
    padded = np.full(blocks * _BLOCK, outside, np.float32)
    padded[1 : shape[0] - 1, 1 : shape[1] - 1, 1 : shape[2] - 1] = values
    nudge = np.float32(1e-3 * voxel)  # a vertex on a grid point would make triangles without area
    padded = np.where(np.abs(padded) < nudge, nudge, padded)
    split = padded.reshape(blocks[0], _BLOCK, blocks[1], _BLOCK, blocks[2], _BLOCK).transpose(0, 2, 4, 1, 3, 5)
    table = np.stack(np.meshgrid(*(np.arange(n) for n in blocks), indexing="ij"), -1).reshape(-1, 3).astype(np.int32)
    cubes = np.ascontiguousarray(split.reshape(-1, _BLOCK, _BLOCK, _BLOCK))
    edges, faces = _native.isosurface(table, cubes)
    ends = cubes.reshape(-1)[edges].astype(np.float64)
    share = ends[:, :1] / (ends[:, :1] - ends[:, 1:])
    block, offset = np.divmod(edges, _BLOCK**3)
    index = table[block] * _BLOCK + np.stack(np.unravel_index(offset, (_BLOCK,) * 3), -1) - 1
    vertices = origin + voxel * (index[:, 0] + (index[:, 1] - index[:, 0]) * share)
    return vertices.astype(np.float32), faces
