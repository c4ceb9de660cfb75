"""Closed meshes that models are built from. Metres, z up; a shape stands on z = 0 with its axis on x = y = 0."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, kw_only=True, eq=False)
class PartMesh:
    """Triangle mesh of one part, metres. Those made here are closed: every edge on two faces, fronts outside."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "t 3"]

    def moved(self, x: float | int = 0, y: float | int = 0, z: float | int = 0) -> "PartMesh":
        """The mesh, shifted."""
        return PartMesh(vertices=self.vertices + np.array([x, y, z]), faces=self.faces)

    def turned(self, axis: str, angle: float) -> "PartMesh":
        """The mesh, rotated about a coordinate axis through the origin, radians, right-handed."""
        return PartMesh(vertices=self.vertices @ rotation(axis, angle).T, faces=self.faces)

    def bent(self, displacement: Float[np.ndarray, "v 3"]) -> "PartMesh":
        """The mesh with each vertex displaced."""
        return PartMesh(vertices=self.vertices + displacement, faces=self.faces)


def rotation(axis: str, angle: float) -> Float[np.ndarray, "3 3"]:
    """Right-handed rotation about the axis named x, y or z."""
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i] = np.sin(angle)
    matrix[i, j] = -matrix[j, i]
    return matrix


def rounded_box(
    size: tuple[float, float, float], radius: float = 0.004, segments: int = 1, divisions: int = 1
) -> PartMesh:
    """A box with rounded edges; one segment makes a chamfer, `divisions` cut each flat side for later bending."""
    half = np.array(size) / 2
    radius = min(radius, half.min() * 0.999)
    arc = np.tan(np.linspace(-np.pi / 4, 0, segments + 1))[:-1] if segments > 1 else np.array([-1.0])
    lines = []
    for extent in half:
        flat = np.linspace(-(extent - radius), extent - radius, divisions + 1)
        rim = (extent - radius) + radius * -arc[::-1]
        lines.append(np.concatenate([-rim[::-1], flat, rim]))
    vertices, faces = _box_surface(lines)
    inner = np.clip(vertices, -(half - radius), half - radius)
    outward = vertices - inner
    vertices = inner + radius * outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    return PartMesh(vertices=vertices + np.array([0, 0, half[2]]), faces=faces)


def cushion(size: tuple[float, float, float], radius: float, puff: float) -> PartMesh:
    """A soft box: round edges, and every side swollen by up to `puff` in its middle."""
    box = rounded_box(size, radius, segments=4, divisions=6)
    half = np.array(size) / 2
    centred = box.vertices - np.array([0, 0, half[2]])
    unit = np.clip(centred / half, -1, 1)
    bulge = np.zeros_like(centred)
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        bulge[:, axis] = puff * unit[:, axis] * (1 - unit[:, i] ** 2) * (1 - unit[:, j] ** 2)
    bulge[:, 2] += puff  # still stands on z = 0 in the middle of its lower side
    return box.bent(bulge)


def lathe(profile: Float[np.ndarray, "k 2"], segments: int = 32) -> PartMesh:
    """The solid of revolution of (radius, z) points, from the axis outwards, up, and back to the axis.

    The first and the last point must have radius 0, all others more.
    """
    rings = profile[1:-1]
    angles = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], -1)
    sides = rings[:, None, :1] * circle
    heights = np.broadcast_to(rings[:, None, 1:], (len(rings), segments, 1))
    ends = np.array([[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]])
    vertices = np.concatenate([ends, np.concatenate([sides, heights], -1).reshape(-1, 3)])
    return PartMesh(vertices=vertices, faces=_ring_faces(len(rings), segments))


def smooth_profile(points: list[tuple[float | int, float | int]], steps: int = 5) -> Float[np.ndarray, "k 2"]:
    """A Catmull-Rom curve through (radius, z) points, `steps` pieces between two of them; radii stay positive."""
    given = np.array(points)
    padded = np.concatenate([2 * given[:1] - given[1:2], given, 2 * given[-1:] - given[-2:-1]])
    pieces = []
    for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        t = np.linspace(0, 1, steps, endpoint=False)[:, None]
        pieces.append(0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * (b - c) + d - a) * t**3))
    curve = np.concatenate([*pieces, given[-1:]])
    curve[1:-1, 0] = np.maximum(curve[1:-1, 0], 1e-3)
    curve[[0, -1], 0] = given[[0, -1], 0]
    curve[:, 1] = np.clip(curve[:, 1], given[:, 1].min(), given[:, 1].max())
    return curve


def cylinder(
    radius: float, height: float, bevel: float = 0.003, segments: int = 28, top: float | None = None
) -> PartMesh:
    """A cylinder, or a cone frustum with radius `top` above, with chamfered rims."""
    upper = radius if top is None else top
    points = [
        (0, 0),
        (radius - bevel, 0),
        (radius, bevel),
        (upper, height - bevel),
        (upper - bevel, height),
        (0, height),
    ]
    return lathe(np.array(points, np.float64), segments)


def ball(radius: float, segments: int = 32) -> PartMesh:
    """A sphere that stands on z = 0."""
    theta = np.linspace(0, np.pi, segments // 2 + 1)
    profile = np.stack([radius * np.sin(theta), radius * (1 - np.cos(theta))], -1)
    profile[[0, -1], 0] = 0.0
    return lathe(profile, segments)


def prism(outline: Float[np.ndarray, "k 2"], height: float, bevel: float = 0.003) -> PartMesh:
    """A convex outline (counter-clockwise round the origin, which lies inside) drawn up, its rims chamfered."""
    shrunk = outline * (1 - bevel / np.linalg.norm(outline, axis=-1, keepdims=True))
    layers = [(shrunk, 0.0), (outline, bevel), (outline, height - bevel), (shrunk, height)]
    rings = [np.concatenate([line, np.full((len(line), 1), z)], -1) for line, z in layers]
    ends = np.array([[0.0, 0, 0], [0, 0, height]])
    return PartMesh(vertices=np.concatenate([ends, *rings]), faces=_ring_faces(len(rings), len(outline)))


def rounded_rectangle(width: float, depth: float, radius: float, segments: int = 6) -> Float[np.ndarray, "k 2"]:
    """The outline of a table top with round corners, counter-clockwise."""
    corners = []
    for turn, (sx, sy) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        angles = np.linspace(0, np.pi / 2, segments + 1) + turn * np.pi / 2
        middle = np.array([sx * (width / 2 - radius), sy * (depth / 2 - radius)])
        corners.append(middle + radius * np.stack([np.cos(angles), np.sin(angles)], -1))
    return np.concatenate(corners)


def tube(path: Float[np.ndarray, "k 3"], radii: Float[np.ndarray, "k"] | float, sides: int = 12) -> PartMesh:
    """A round bar along a path, its flat ends square to it."""
    widths = np.broadcast_to(np.asarray(radii, np.float64), (len(path),))
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    across = np.cross(tangents[0], np.eye(3)[np.abs(tangents[0]).argmin()])
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    rings = []
    for point, tangent, width in zip(path, tangents, widths, strict=True):
        across = across - (across @ tangent) * tangent  # carried along the path without twist
        across /= np.linalg.norm(across)
        beside = np.cross(tangent, across)
        rings.append(point + width * (np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * beside))
    vertices = np.concatenate([path[[0, -1]], *rings])
    return PartMesh(vertices=vertices, faces=_ring_faces(len(path), sides))


def _ring_faces(rings: int, segments: int) -> Int[np.ndarray, "t 3"]:
    """Faces between rings of vertices that start at index 2; vertices 0 and 1 close the lower and the upper end."""
    here = 2 + np.arange(segments)
    after = np.roll(here, -1)
    top = (rings - 1) * segments
    faces = [
        np.stack([np.zeros_like(here), after, here], -1),
        np.stack([np.ones_like(here), here + top, after + top], -1),
    ]
    for low in range(0, top, segments):
        a, b, c, d = here + low, after + low, after + low + segments, here + low + segments
        faces += [np.stack([a, b, c], -1), np.stack([a, c, d], -1)]
    return np.concatenate(faces).astype(np.int32)


def _box_surface(lines: list[Float[np.ndarray, "_"]]) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """The surface of a grid of grid lines along x, y and z, welded."""
    counts = [len(line) for line in lines]
    corners = []
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        a, b = np.meshgrid(np.arange(counts[i] - 1), np.arange(counts[j] - 1), indexing="ij")
        for side in (0, counts[axis] - 1):
            quad = np.zeros((a.size, 4, 3), np.int64)
            quad[..., axis] = side
            quad[..., i] = a.reshape(-1, 1) + np.array([0, 1, 1, 0])
            quad[..., j] = b.reshape(-1, 1) + np.array([0, 0, 1, 1])
            corners.append(quad if side else quad[:, ::-1])
    flat = np.concatenate(corners).reshape(-1, 3)
    keys, index = np.unique(flat, axis=0, return_inverse=True)
    quads = index.reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    vertices = np.stack([line[keys[:, axis]] for axis, line in enumerate(lines)], -1)
    return vertices, faces
