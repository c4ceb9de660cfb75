"""Fusing one depth image, one voxel at a time, in float64."""

import math

import numpy as np

DISTANCE, WEIGHT, VIEWS, OTHER, EMPTY, COLOUR = 0, 1, 2, 3, 4, slice(5, 8)


def fuse_view(origin, voxel, truncation, blocks, view, wanted):
    """Sums (b 8 8 8 8) that one view adds; `wanted` None takes every pixel."""
    sums = np.zeros((len(blocks), 8, 8, 8, 8))
    (fx, fy), (cx, cy) = view.camera.focal_px.tolist(), view.camera.centre_px.tolist()
    pose = view.camera.cam_from_world.double().numpy()[:3]
    height, width = view.depth.shape
    for block, i, j, k in np.ndindex(len(blocks), 8, 8, 8):
        point = origin + voxel * (8 * np.asarray(blocks[block]) + (i, j, k))
        x, y, z = pose[:, :3] @ point + pose[:, 3]
        if z <= 0:
            continue
        u, v = fx * x / z + cx, fy * y / z + cy
        column, row = math.floor(u), math.floor(v)
        if not (0 <= column < width and 0 <= row < height):
            continue
        slope = float(view.slope[row, column])
        if math.isnan(slope) or z - view.depth[row, column] > 2 * truncation:
            continue
        depth = depth_at(view, u, v, row, column, 2 * truncation, wanted is not None)
        distance, weight = (depth - z) * slope, slope / z**2
        own = wanted is None or view.ids[row, column] == wanted
        sum_ = sums[block, i, j, k]
        if distance > voxel / 2 and (not own or depth - z > truncation):
            sum_[EMPTY] += weight
        if abs(distance) > truncation:
            continue
        faded = weight * min(1.0, (truncation + distance) / (truncation - voxel))
        if own:
            sum_[DISTANCE] += faded * distance
            sum_[WEIGHT] += faded
            sum_[VIEWS] += 1
            sum_[COLOUR] += faded * view.colours[row, column]
        elif view.ids[row, column] >= 0:
            sum_[OTHER] += faded
    return sums


def depth_at(view, u, v, row, column, agree, use_ids):
    """Bilinear between pixel centres where the four are one surface, else the pixel's own."""
    x, y = math.floor(u - 0.5), math.floor(v - 0.5)
    height, width = view.depth.shape
    if x < 0 or y < 0 or x + 1 >= width or y + 1 >= height:
        return float(view.depth[row, column])
    four = view.depth[y : y + 2, x : x + 2].astype(np.float64)
    if np.isnan(four).any() or four.max() - four.min() > agree:
        return float(view.depth[row, column])
    if use_ids and (view.ids[y : y + 2, x : x + 2] != view.ids[row, column]).any():
        return float(view.depth[row, column])
    s, t = u - 0.5 - x, v - 0.5 - y
    return float(np.array([1 - t, t]) @ four @ np.array([1 - s, s]))
