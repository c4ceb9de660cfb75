"""Finds the free, flat, upward areas of a mesh on which objects can stand."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from goc.geometry.raycast import TriangleScene
from goc.synth.model import Top
from goc.synth.vectors import unit

_CELL = 0.015
"""Metres between the vertical rays that look for surfaces."""
_MOST_CELLS = 220
_MOST_LAYERS = 24
_LEVEL = np.cos(np.radians(5.0))
_BUMP = 0.003
"""Metres that a top may lie above or below its middle height."""
_LOWEST, _HIGHEST = 0.1, 1.35
_SMALLEST = 0.12
_HEADROOM = 0.08
_MOST_TOPS = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class _Columns:
    """Surfaces that vertical rays on a grid (i, j) hit, from the top down: k layers."""

    x: Float[np.ndarray, "i"]
    y: Float[np.ndarray, "j"]
    z: Float[np.ndarray, "k i j"]
    """Heights of surfaces that face upwards and are level; NaN elsewhere."""
    clearance: Float[np.ndarray, "k i j"]
    """Free height above each."""


def find_tops(scene: TriangleScene) -> tuple[Top, ...]:
    """Level rectangles along x and y of at least 12 by 12 cm, 10 to 135 cm high, with 8 cm of air above; best first.

    Vertical rays every 15 mm find the surfaces; their normals must point upwards. Heights with much level area are
    searched for the largest rectangle that is free everywhere, and for a second one beside it.

    Args:
        scene: of a mesh that stands on z = 0.
    """
    columns = _columns(scene)
    tops: list[Top] = []
    taken = np.zeros_like(columns.z, bool)
    for _ in range(_MOST_TOPS):
        free = np.isfinite(columns.z) & ~taken & (columns.clearance >= _HEADROOM)
        free &= (np.nan_to_num(columns.z) >= _LOWEST) & (np.nan_to_num(columns.z) <= _HIGHEST)
        if not free.any():
            break
        bins = np.round(columns.z[free] / _BUMP).astype(int)
        height = np.bincount(bins).argmax() * _BUMP
        level = free & (np.abs(np.nan_to_num(columns.z) - height) <= _BUMP)
        flat = level.any(0)
        i0, i1, j0, j1 = largest_rectangle(flat)
        inside = np.zeros_like(level)
        inside[:, i0:i1, j0:j1] = level[:, i0:i1, j0:j1]
        top = _top(columns, inside, (i0, i1, j0, j1))
        if min(top.width, top.depth) < _SMALLEST:
            taken |= level  # nothing of use is left at this height
        else:
            tops.append(top)
            taken |= inside
    return tuple(sorted(tops, key=lambda top: -top.width * top.depth))


def _columns(scene: TriangleScene) -> _Columns:
    low, high = scene.vertices.min(0).astype(float), scene.vertices.max(0).astype(float)
    cell = max(_CELL, (high - low)[:2].max() / _MOST_CELLS)
    x, y = (np.arange(low[a] + cell / 2, high[a], cell) for a in (0, 1))
    start = np.stack(np.meshgrid(x, y, [high[2] + 0.1], indexing="ij"), -1).reshape(-1, 3)
    # Askew by a hair: no ray runs down a vertical side.
    down = np.broadcast_to(np.array([1.7e-5, 2.3e-5, -1.0]), start.shape)
    corners = scene.vertices[scene.faces].astype(np.float64)
    up = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))[:, 2]
    heights, clearances = [], []
    ceiling = np.full(len(start), np.inf)
    position = start.copy()
    for _ in range(_MOST_LAYERS):
        hits = scene.closest_hit(position, down)
        if not hits.found.any():
            break
        z = np.where(hits.found, position[:, 2] - hits.t, np.nan)
        flat = hits.found & (up[hits.triangle] >= _LEVEL)
        heights.append(np.where(flat, z, np.nan))
        clearances.append(np.where(flat, ceiling - z, 0.0))
        ceiling = np.where(hits.found, z, ceiling)
        position[:, 2] = np.where(hits.found, z - 1e-4, position[:, 2])
        position[~hits.found, 2] = low[2] - 1.0  # below everything: hits nothing more
    shape = (len(heights), len(x), len(y))
    return _Columns(x=x, y=y, z=np.array(heights).reshape(shape), clearance=np.array(clearances).reshape(shape))


def _top(columns: _Columns, inside: Bool[np.ndarray, "k i j"], box: tuple[int, int, int, int]) -> Top:
    """The rectangle between the middles of its outermost cells."""
    i0, i1, j0, j1 = box
    (x0, x1), (y0, y1) = columns.x[[i0, i1 - 1]], columns.y[[j0, j1 - 1]]
    return Top(
        x=float(x0 + x1) / 2,
        y=float(y0 + y1) / 2,
        z=float(columns.z[inside].max()),
        width=float(x1 - x0),
        depth=float(y1 - y0),
        clearance=float(columns.clearance[inside].min()),
    )


def largest_rectangle(free: Bool[np.ndarray, "i j"]) -> tuple[int, int, int, int]:
    """The box i0:i1, j0:j1 of largest area that is free everywhere; needs one free cell."""
    best, box = 0, (0, 0, 0, 0)
    run = np.zeros(free.shape[1], int)
    for i, row in enumerate(free):
        run = np.where(row, run + 1, 0)  # how far up each column is free
        stack: list[tuple[int, int]] = []  # rising runs: where each begins, and its height
        for j, height in enumerate([*run.tolist(), 0]):
            begin = j
            while stack and stack[-1][1] >= height:
                begin, tall = stack.pop()
                if tall * (j - begin) > best:
                    best, box = tall * (j - begin), (i + 1 - tall, i + 1, begin, j)
            stack.append((begin, height))
    return box
