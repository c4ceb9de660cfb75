"""Four kinds of things by their signed distances, z up, about 1 in size, and depth images of them as bare points."""

import numpy as np

from goc.scene import PointCloud


def can(p):
    """A closed cylinder, 0.5 across and 1 high."""
    return _cylinder(p, 0.25, -0.5, 0.5)


def bowl(p):
    """The lower half of a hollow ball, 1 across, its wall 0.08 thick."""
    length = np.linalg.norm(p, axis=-1)
    return np.maximum(np.abs(length - 0.46) - 0.04, p[..., 2])


def mug(p):
    """A cylinder open above, with a ring for a handle."""
    cup = np.maximum(_cylinder(p, 0.4, -0.5, 0.5), -_cylinder(p, 0.32, -0.4, 0.6))
    flat = np.hypot(p[..., 0] - 0.45, p[..., 2]) - 0.22
    handle = np.maximum(np.hypot(flat, p[..., 1]) - 0.05, 0.36 - p[..., 0])
    return np.minimum(cup, handle)


def chair(p):
    """A seat on four legs, with a back."""
    parts = [_box(p, (0, 0, 0), (0.25, 0.25, 0.03)), _box(p, (0.22, 0, 0.27), (0.03, 0.25, 0.27))]
    parts += [_box(p, (x, y, -0.25), (0.03, 0.03, 0.25)) for x in (-0.22, 0.22) for y in (-0.22, 0.22)]
    return np.minimum.reduce(parts)


def seen_from(thing, eye, side=90, noise=0.003, seed=0):
    """What a depth camera at `eye`, looking at the origin, sees: points with noise along the rays, world frame."""
    eye = np.array(eye, np.float64)
    away = np.linalg.norm(eye)
    steps = np.linspace(-0.8, 0.8, side) / away
    rays = np.stack([axis.ravel() for axis in np.meshgrid(steps, steps)] + [np.ones(side * side)], -1) @ camera(eye)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    way = np.full(len(rays), away - 1.0)
    for _ in range(60):
        way += thing(eye + way[:, None] * rays)
    hit = np.abs(thing(eye + way[:, None] * rays)) < 1e-3
    way = way + noise * np.random.default_rng(seed).normal(size=len(way))
    return bare(eye + way[hit, None] * rays[hit])


def camera(eye):
    """Rows: right, down, forward of a level camera at `eye` that looks at the origin."""
    forward = -np.array(eye, np.float64) / np.linalg.norm(eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def bare(points):
    """Points without normals, of one colour."""
    points = np.asarray(points, np.float32)
    return PointCloud(positions=points, colours=np.full(points.shape, 128, np.uint8))


def _cylinder(p, radius, low, high):
    return np.maximum(np.hypot(p[..., 0], p[..., 1]) - radius, np.maximum(low - p[..., 2], p[..., 2] - high))


def _box(p, centre, half):
    off = np.abs(p - np.array(centre)) - np.array(half)
    return np.linalg.norm(np.maximum(off, 0), axis=-1) + np.minimum(off.max(axis=-1), 0)
