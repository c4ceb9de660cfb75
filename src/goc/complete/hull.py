"""The evidence hull: the largest solid that agrees with every ray. A completion that needs no learning."""

import math

import numpy as np
from jaxtyping import Bool, Float32

from goc.scene import Evidence, EvidenceGrid

BAND = 3.0
"""Distances are cut off at this many voxels."""
_LEAST = 0.05
"""Distance, in voxels, that a voxel seen empty keeps from every surface."""
_ROUNDS = 8


def evidence_hull(evidence: EvidenceGrid) -> Float32[np.ndarray, "x y z"]:
    """Signed distance to the largest solid that contradicts no ray, in voxels, positive outside, cut off at BAND.

    Where the object's surface was measured it is the fused distance, to the last bit. Voxels seen empty are outside.
    All the rest counts as solid. Where solid and empty meet without a measurement between, the border is a staircase of
    voxels; it is relaxed into the solid, never into the empty, with the measured distance held, so that the surface
    goes on smoothly from what was seen.
    """
    seen, empty = evidence.state == Evidence.SURFACE, evidence.state == Evidence.EMPTY
    measured = np.clip(evidence.sdf / np.float32(evidence.voxel), -BAND, BAND).astype(np.float32)
    return relaxed(np.where(seen, measured, _steps(empty)), seen, empty, _ROUNDS)


def relaxed(
    distance: Float32[np.ndarray, "x y z"],
    held: Bool[np.ndarray, "x y z"],
    empty: Bool[np.ndarray, "x y z"],
    rounds: int,
) -> Float32[np.ndarray, "x y z"]:
    """Even out a signed distance in voxels: held voxels stay as they are, empty ones stay outside.

    Only the neighbourhood of the zero level of what is free is worked on; the rest is returned as it came.
    """
    free = ~held & (np.abs(distance) < BAND - 0.5)
    at = np.nonzero(free)
    if len(at[0]) == 0:
        return distance
    box = tuple(slice(max(int(axis.min()) - 1, 0), int(axis.max()) + 2) for axis in at)
    part, moves, outside = distance[box].copy(), free[box], empty[box] & free[box]
    for _ in range(rounds):
        part = np.where(moves, 0.5 * part + 0.5 * neighbour_mean(part), part)
        part = np.where(outside, np.maximum(part, np.float32(_LEAST)), part)
    result = distance.copy()
    result[box] = part
    return result


def neighbour_mean(field: Float32[np.ndarray, "x y z"]) -> Float32[np.ndarray, "x y z"]:
    """Mean of the six neighbours; at the border a voxel stands in for the neighbour it lacks."""
    total = np.zeros_like(field)
    for axis in range(3):
        below, above = [slice(None)] * 3, [slice(None)] * 3
        below[axis], above[axis] = slice(None, -1), slice(1, None)
        first, last = [slice(None)] * 3, [slice(None)] * 3
        first[axis], last[axis] = slice(None, 1), slice(-1, None)
        total[tuple(above)] += field[tuple(below)]
        total[tuple(below)] += field[tuple(above)]
        total[tuple(first)] += field[tuple(first)]
        total[tuple(last)] += field[tuple(last)]
    return total / np.float32(6)


def _steps(empty: Bool[np.ndarray, "x y z"]) -> Float32[np.ndarray, "x y z"]:
    """Signed distance to the faces between empty voxels and the rest, in voxels, cut off at BAND."""
    return (_apart(empty, ~empty) - _apart(~empty, empty)).astype(np.float32)


def _apart(inner: Bool[np.ndarray, "x y z"], other: Bool[np.ndarray, "x y z"]) -> Float32[np.ndarray, "x y z"]:
    """Distance of inner voxels from the nearest other voxel's near face; 0 elsewhere.

    Squared distances axis by axis (Felzenszwalb and Huttenlocher 2012), by brute force since the band is narrow.
    """
    reach = math.ceil(BAND)
    far = (reach + 1) ** 2  # no sum of steps comes near the 255 of a byte
    squared = np.where(other, np.uint8(0), np.uint8(far))
    for axis in range(3):
        lines = np.moveaxis(squared, axis, 0)
        nearest = lines.copy()
        for step in range(1, min(reach, len(lines) - 1) + 1):
            np.minimum(nearest[step:], lines[:-step] + np.uint8(step**2), out=nearest[step:])
            np.minimum(nearest[:-step], lines[step:] + np.uint8(step**2), out=nearest[:-step])
        squared = np.moveaxis(np.minimum(nearest, np.uint8(far)), 0, axis)
    roots = np.clip(np.sqrt(np.arange(far + 1)) - 0.5, 0, BAND).astype(np.float32)
    return np.where(inner, roots[squared], np.float32(0))
