"""Signed distances of geometric primitives, exact where there is a closed form; negative inside.

Coordinates come as three arrays that broadcast against each other, so that a primitive aligned with its grid costs
little: what depends on x alone is computed once a column.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

Field = Float32[np.ndarray, "..."]
Number = float | int
Triple = tuple[Number, Number, Number]


@runtime_checkable
class Primitive(Protocol):
    """A shape with a signed distance, centred near the origin of its own frame."""

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """Signed distance at coordinates in the body's frame."""
        ...

    def half_extent(self) -> Triple:
        """Half sides of a box round the origin that holds the body."""
        ...


@dataclass(frozen=True)
class Box:
    """A box with round edges."""

    sides: Triple
    radius: Number = 0.0

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """Exact (Quilez)."""
        over = [np.abs(c) - np.float32(side / 2 - self.radius) for c, side in zip((x, y, z), self.sides, strict=True)]
        beyond = np.sqrt(sum(np.maximum(c, 0) ** 2 for c in over))
        return beyond + np.minimum(np.maximum(np.maximum(over[0], over[1]), over[2]), 0) - np.float32(self.radius)

    def half_extent(self) -> Triple:
        """Half sides."""
        return tuple(side / 2 for side in self.sides)


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid along the axes."""

    radii: Triple

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """First order near the surface, where it matters; the sign is exact."""
        scaled = [c / np.float32(r) for c, r in zip((x, y, z), self.radii, strict=True)]
        near = np.sqrt(sum(c**2 for c in scaled))
        slope = np.sqrt(sum((c / np.float32(r)) ** 2 for c, r in zip(scaled, self.radii, strict=True)))
        return np.where(near < 1e-3, np.float32(-min(self.radii)), near * (near - 1) / np.maximum(slope, 1e-6))

    def half_extent(self) -> Triple:
        """The radii."""
        return self.radii


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z with round rims."""

    width: Number
    """Radius."""
    height: Number
    radius: Number = 0.0
    """Radius of the rounded rims."""

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """Exact."""
        side = np.sqrt(x**2 + y**2) - np.float32(self.width - self.radius)
        end = np.abs(z) - np.float32(self.height / 2 - self.radius)
        beyond = np.sqrt(np.maximum(side, 0) ** 2 + np.maximum(end, 0) ** 2)
        return beyond + np.minimum(np.maximum(side, end), 0) - np.float32(self.radius)

    def half_extent(self) -> Triple:
        """Half sides."""
        return self.width, self.width, self.height / 2


@dataclass(frozen=True)
class Torus:
    """A ring round z."""

    ring: Number
    tube: Number

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """Exact."""
        return np.sqrt((np.sqrt(x**2 + y**2) - np.float32(self.ring)) ** 2 + z**2) - np.float32(self.tube)

    def half_extent(self) -> Triple:
        """Half sides."""
        return self.ring + self.tube, self.ring + self.tube, self.tube


@dataclass(frozen=True, eq=False)
class Prism:
    """A simple polygon in x and y, drawn along z."""

    outline: Float[np.ndarray, "k 2"]
    height: Number
    radius: Number = 0.0
    """Distance by which the prism is grown, which rounds its edges."""

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """Exact."""
        side = polygon_distance(self.outline, x, y)
        end = np.abs(z) - np.float32(self.height / 2 - self.radius)
        beyond = np.sqrt(np.maximum(side, 0) ** 2 + np.maximum(end, 0) ** 2)
        return beyond + np.minimum(np.maximum(side, end), 0) - np.float32(self.radius)

    def half_extent(self) -> Triple:
        """Half sides of a box round the origin."""
        reach = np.abs(self.outline).max(0) + self.radius
        return float(reach[0]), float(reach[1]), self.height / 2


@dataclass(frozen=True, eq=False)
class Lathe:
    """A simple polygon of (radius, z) turned round z: bowls, bottles, shades. Edges that end on the axis are level."""

    profile: Float[np.ndarray, "k 2"]

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """Exact outside; inside too, but for edges on the axis, which count as surface."""
        return polygon_distance(self._mirrored(), np.sqrt(x**2 + y**2), z)

    def half_extent(self) -> Triple:
        """Half sides of a box round the origin."""
        reach = float(self.profile[:, 0].max())
        return reach, reach, float(np.abs(self.profile[:, 1]).max())

    def _mirrored(self) -> Float[np.ndarray, "k 2"]:
        """Corners on the axis moved across it, so that the axis is no edge."""
        away = np.ptp(self.profile[:, 0])
        return np.where(self.profile == 0, [[-away, 0.0]], self.profile) if away > 0 else self.profile


@dataclass(frozen=True, eq=False)
class Shrunk:
    """Another primitive, its surface moved inwards by `by`: subtracted from the primitive, it leaves an even wall."""

    body: Primitive
    by: Number

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """As exact as the body's own."""
        return self.body.distance(x, y, z) + np.float32(self.by)

    def half_extent(self) -> Triple:
        """Half sides of a box round the origin."""
        return self.body.half_extent()


@dataclass(frozen=True, eq=False)
class Tube:
    """A round bar along a line of points, with round ends."""

    line: Float[np.ndarray, "k 3"]
    width: Number
    """Radius."""

    def distance(self, x: Field, y: Field, z: Field) -> Field:
        """Exact."""
        nearest: Field | None = None
        for a, b in zip(self.line, self.line[1:], strict=False):
            along = (b - a).astype(np.float32)
            rest = [c - np.float32(start) for c, start in zip((x, y, z), a, strict=True)]
            share = sum(r * d for r, d in zip(rest, along, strict=True)) / np.float32(max(along @ along, 1e-12))
            share = np.clip(share, 0, 1)
            squared = sum((r - share * d) ** 2 for r, d in zip(rest, along, strict=True))
            nearest = squared if nearest is None else np.minimum(nearest, squared)
        return np.sqrt(nearest) - np.float32(self.width)

    def half_extent(self) -> Triple:
        """Half sides of a box round the origin."""
        return tuple(float(v) for v in np.abs(self.line).max(0) + self.width)


def polygon_distance(outline: Float[np.ndarray, "k 2"], x: Field, y: Field) -> Field:
    """Signed distance to a simple polygon, corners in any turn (Quilez)."""
    squared: Field | None = None
    inside: np.ndarray | None = None
    for a, b in zip(outline, np.roll(outline, -1, 0), strict=True):
        edge = (b - a).astype(np.float32)
        u, v = x - np.float32(a[0]), y - np.float32(a[1])
        share = np.clip((u * edge[0] + v * edge[1]) / np.float32(max(edge @ edge, 1e-12)), 0, 1)
        here = (u - share * edge[0]) ** 2 + (v - share * edge[1]) ** 2
        squared = here if squared is None else np.minimum(squared, here)
        crosses = ((v >= 0) & (y < np.float32(b[1]))) | ((v < 0) & (y >= np.float32(b[1])))
        left = crosses & ((u * edge[1] > v * edge[0]) == (edge[1] < 0))
        inside = left if inside is None else inside ^ left
    return np.where(inside, -1, 1).astype(np.float32) * np.sqrt(squared)
