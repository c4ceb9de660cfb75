"""The surface of a signed distance on a dense grid."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32

from goc import _native

_BLOCK = 8
_APART = 0.01
"""Least distance of a vertex from the grid points at its edge's ends, in edges: nearer, rounding would take
the area of triangles."""


def grid_surface(
    values: Float[np.ndarray, "x y z"], origin: Float[np.ndarray, "3"] | Float64[np.ndarray, "3"], voxel: float
) -> tuple[Float32[np.ndarray, "v 3"], Int32[np.ndarray, "t 3"]]:
    """Zero level by marching cubes, counter-clockwise from the positive side, closed also where the grid ends.

    Watertight by construction: every edge is on exactly two faces, whatever the values (docs/decisions/0021).

    Args:
        values: at origin + voxel · (i, j, k), negative inside.
        origin: position of values[0, 0, 0].
        voxel: edge of a cell.

    Returns:
        Vertices and faces, one vertex a crossed edge of the grid.
    """
    shape = np.array(values.shape) + 2
    count = -(-shape // _BLOCK)
    padded = np.full(count * _BLOCK, np.float32(voxel), np.float32)
    padded[1 : shape[0] - 1, 1 : shape[1] - 1, 1 : shape[2] - 1] = values
    split = padded.reshape(count[0], _BLOCK, count[1], _BLOCK, count[2], _BLOCK).transpose(0, 2, 4, 1, 3, 5)
    inside = split < 0
    chosen = _crossed(np.any(inside, axis=(3, 4, 5)), np.all(inside, axis=(3, 4, 5)))
    blocks = np.argwhere(chosen).astype(np.int32)
    cubes = np.ascontiguousarray(split[chosen])
    edges, faces = _native.isosurface(blocks, cubes)
    ends = cubes.reshape(-1)[edges].astype(np.float64)
    share = np.clip(ends[:, :1] / (ends[:, :1] - ends[:, 1:]), _APART, 1 - _APART)
    block, offset = np.divmod(edges, _BLOCK**3)
    index = blocks[block] * _BLOCK + np.stack(np.unravel_index(offset, (_BLOCK,) * 3), -1) - 1
    vertices = origin + voxel * (index[:, 0] + (index[:, 1] - index[:, 0]) * share)
    return vertices.astype(np.float32), faces


def _crossed(some: Bool[np.ndarray, "x y z"], every: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Blocks whose cells the surface may cross, and the upper neighbours that those cells reach into."""
    low, high = every.copy(), some.copy()
    for axis in range(3):
        here, above = [slice(None)] * 3, [slice(None)] * 3
        here[axis], above[axis] = slice(None, -1), slice(1, None)
        low[tuple(here)] &= low[tuple(above)].copy()
        high[tuple(here)] |= high[tuple(above)].copy()
    chosen = high & ~low
    for axis in range(3):
        here, above = [slice(None)] * 3, [slice(None)] * 3
        here[axis], above[axis] = slice(None, -1), slice(1, None)
        chosen[tuple(above)] |= chosen[tuple(here)].copy()
    return chosen
