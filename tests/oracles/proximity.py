"""Distances, winding numbers and crossings triangle by triangle: the obvious twins of goc.geometry.raycast."""

import itertools

import numpy as np


def distance(point, corners):
    """From a point to a triangle: the least over a face interior and three segments, by constrained least squares."""
    a, b, c = corners.astype(np.float64)
    frame = np.stack([b - a, c - a], axis=1)
    best = min(_to_segment(point, p, q) for p, q in ((a, b), (b, c), (c, a)))
    if np.linalg.matrix_rank(frame) == 2:
        s, t = np.linalg.lstsq(frame, point - a, rcond=None)[0]
        if s >= 0 and t >= 0 and s + t <= 1:
            best = min(best, np.linalg.norm(point - a - frame @ (s, t)))
    return best


def winding(point, vertices, faces):
    """The generalised winding number: solid angles of all triangles (Van Oosterom and Strackee 1983) over 4 pi."""
    total = 0.0
    for face in faces:
        a, b, c = vertices[face].astype(np.float64) - point
        la, lb, lc = (np.linalg.norm(v) for v in (a, b, c))
        below = la * lb * lc + (a @ b) * lc + (b @ c) * la + (c @ a) * lb
        total += 2 * np.arctan2(a @ np.cross(b, c), below)
    return total / (4 * np.pi)


def crossing_pairs(vertices, faces):
    """Pairs of triangles that share a segment of positive length and are not coplanar, by clipping."""
    corners = vertices[faces].astype(np.float64)
    return [(i, j) for i, j in itertools.combinations(range(len(faces)), 2) if cut(corners[i], corners[j])]


def cut(first, second, least=1e-7):
    """Cut the first triangle by the second's plane, and clip the segment so found by the second's three edges."""
    normal = np.cross(second[1] - second[0], second[2] - second[0])
    normal = normal / np.linalg.norm(normal)
    heights = (first - second[0]) @ normal
    heights[np.abs(heights) < 1e-9] = 0
    if not ((heights > 0).any() and (heights < 0).any()):
        return False
    ends = [first[i] for i in range(3) if heights[i] == 0]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        if heights[i] * heights[j] < 0:
            ends.append(first[i] + heights[i] / (heights[i] - heights[j]) * (first[j] - first[i]))
    start, way = ends[0], ends[1] - ends[0]
    low, high = 0.0, 1.0
    for i, j in ((0, 1), (1, 2), (2, 0)):
        inward = np.cross(normal, second[j] - second[i])
        inward = inward / np.linalg.norm(inward)
        here, slope = (start - second[i]) @ inward, way @ inward
        if abs(slope) < 1e-12:
            if here <= 1e-9:
                return False  # along or outside this edge: touches at most
            continue
        at = -here / slope
        low, high = (max(low, at), high) if slope > 0 else (low, min(high, at))
    if (high - low) * np.linalg.norm(way) <= least:
        return False
    # Both must reach to both sides of the other's plane: an edge that lies in a plane touches it.
    other = np.cross(first[1] - first[0], first[2] - first[0])
    sides = (second - first[0]) @ (other / np.linalg.norm(other))
    return bool((sides > 1e-9).any() and (sides < -1e-9).any())


def _to_segment(point, p, q):
    way = q - p
    square = way @ way
    t = np.clip((point - p) @ way / square, 0, 1) if square > 0 else 0.0
    return np.linalg.norm(point - p - t * way)
