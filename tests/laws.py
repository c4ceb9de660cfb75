"""Laws over many regimes: one table a kind of input, and `over`, which runs a test for each combination.

A regime is a way in which input can be awkward: tiny, huge, nearly nothing, exactly on an axis, empty. A law names
the tables it holds for, and pytest names the regime that breaks it:

    @over(quats=ROTATIONS, dtype=DTYPES)
    def test_matrices_are_orthonormal(quats, dtype): ...
"""

from collections.abc import Callable, Mapping

import numpy as np
import pytest
import torch

from cameras import pinhole, placed, random_poses, turned
from goc.scene import Mesh
from solids import cube, cuboid, joined, moved, sphere, unwelded


def over(**tables: Mapping[str, object]) -> Callable:
    """Run a test for each combination of the regimes of its arguments, which are named in the test's id."""

    def repeated(test: Callable) -> Callable:
        for argument, table in tables.items():
            test = pytest.mark.parametrize(argument, list(table.values()), ids=list(table))(test)
        return test

    return repeated


def only(table: Mapping[str, object], *names: str) -> dict[str, object]:
    """Some regimes of a table."""
    return {name: table[name] for name in names}


def close(found, expected, size=1.0, ulps=16) -> None:
    """Equal up to `ulps` roundings of numbers of magnitude `size`, in the coarser precision of the two."""
    found, expected = np.asarray(found), np.asarray(expected)
    rounding = max(np.finfo(x.dtype).eps if x.dtype.kind == "f" else 0.0 for x in (found, expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=ulps * rounding * size)


def _normal(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape)


def _about(axes: np.ndarray, angles) -> torch.Tensor:
    """Unit quaternions wxyz of turns about axes of any length."""
    unit = axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    half = np.broadcast_to(np.asarray(angles, np.float64) / 2, unit.shape[:1])[:, None]
    return torch.from_numpy(np.concatenate([np.cos(half), np.sin(half) * unit], -1))


DTYPES = {"float32": torch.float32, "float64": torch.float64}
SCALES = {"thousandth": 1e-3, "tenth": 0.1, "one": 1.0, "thirty": 30.0, "thousand": 1e3}

ROTATIONS: dict[str, torch.Tensor] = {
    "identity": torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=torch.float64),
    "next to identity": _about(_normal(0, 8, 3), 1e-7),
    "near identity": _about(_normal(1, 8, 3), 1e-3),
    "quarter turns": _about(np.eye(3), np.pi / 2),
    "half turns about axes": torch.eye(4, dtype=torch.float64)[1:],
    "half turns": _about(_normal(2, 8, 3), np.pi),
    "nearly half turns": _about(_normal(3, 8, 3), np.pi - 1e-6),
    "more than half turns": _about(_normal(4, 8, 3), 1.9 * np.pi),
    "any": torch.from_numpy(_normal(5, 32, 4)),
    "long": torch.from_numpy(1e3 * _normal(6, 8, 4)),
    "short": torch.from_numpy(1e-3 * _normal(7, 8, 4)),
    "none": torch.zeros(0, 4, dtype=torch.float64),
}
"""Quaternions wxyz (n 4), float64, of any non-zero length."""

DIRECTIONS: dict[str, torch.Tensor] = {
    "along axes": torch.cat([torch.eye(3), -torch.eye(3)]).double(),
    "next to +z": torch.nn.functional.normalize(torch.tensor([[1e-7, 0.0, 1.0], [0.0, -1e-7, 1.0]]).double(), dim=-1),
    "near -z": torch.nn.functional.normalize(torch.tensor([[0.05, 0.0, -1.0], [0.0, -0.1, -1.0]]).double(), dim=-1),
    "across": torch.nn.functional.normalize(torch.tensor([[1.0, 1.0, 0.0], [-1.0, 2.0, 0.0]]).double(), dim=-1),
    "any": torch.nn.functional.normalize(torch.from_numpy(_normal(8, 64, 3)), dim=-1),
    "none": torch.zeros(0, 3, dtype=torch.float64),
}
"""Unit vectors (n 3), float64."""


def rigid(seed: int, reach=2.0) -> np.ndarray:
    """A rigid motion (4 4), float64: any rotation, shifts up to `reach`."""
    return random_poses(1, seed, reach)[0]


MOTIONS: dict[str, np.ndarray] = {
    "still": np.eye(4),
    "shift": placed((0.3, -2.0, 1.1)),
    "half turn": np.diag([-1.0, -1.0, 1.0, 1.0]),
    "near still": turned(_about(_normal(9, 1, 3), 1e-4)[0].tolist(), (1e-4, 0.0, 0.0)),
    "any": rigid(10),
    "another": rigid(11, 5.0),
}
"""World from elsewhere (4 4), float64."""


def _torus(large=1.0, small=0.3, around=32, across=16) -> Mesh:
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    ring = large + small * np.cos(v)
    corners = np.stack([ring * np.cos(u), ring * np.sin(u), small * np.sin(v)], -1).reshape(-1, 3)
    index = np.arange(around * across).reshape(around, across)
    beside, above = np.roll(index, -1, 0), np.roll(index, -1, 1)
    both = np.roll(beside, -1, 1)
    faces = np.concatenate([np.stack([index, beside, both], -1), np.stack([index, both, above], -1)])
    return Mesh(vertices=corners.astype(np.float32), faces=faces.reshape(-1, 3).astype(np.int32))


SOLIDS: dict[str, Mesh] = {
    "cube": cube(),
    "far cube": cube(0.5, (40.0, -30.0, 20.0)),
    "plate": cuboid((-1.0, -1.0, 0.0), (1.0, 1.0, 0.002)),
    "needle": cuboid((0.0, 0.0, -2.0), (0.004, 0.004, 2.0)),
    "ball": sphere(rings=16),
    "ring": _torus(),
    "soup of a ball": unwelded(sphere(rings=8)),
    "two parts": joined(cube(), moved(sphere(0.4, rings=10), (3.0, 0.0, 0.0))),
    "box in a box": joined(cube(3.0, (-1.0, -1.0, -1.0)), cube(0.5)),
}
"""Watertight meshes."""

SHEETS: dict[str, Mesh] = {
    "triangle": Mesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.int32)),
    "sliver": Mesh(
        vertices=np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-4, 0]], np.float32), faces=np.array([[0, 1, 2]], np.int32)
    ),
    "open box": Mesh(vertices=cube().vertices, faces=cube().faces[2:]),
    "hole in a ball": Mesh(vertices=sphere(rings=12).vertices, faces=sphere(rings=12).faces[7:]),
}
"""Meshes with a border."""

CAMERAS = {
    "plain": pinhole(),
    "crooked": pinhole((55.0, 71.0), (61, 47), (20.3, 33.8), rigid(20)),
    "wide": pinhole(12.0, (64, 40), pose=rigid(21)),
    "long": pinhole(900.0, (33, 21), pose=rigid(22)),
    "off the image": pinhole(50.0, (16, 24), (-30.0, 90.0), rigid(23)),
    "one column": pinhole(30.0, (1, 17), pose=rigid(24)),
    "one row": pinhole(30.0, (19, 1), pose=rigid(25)),
    "one pixel": pinhole(3.0, (1, 1), pose=rigid(26)),
    "far away": pinhole(60.0, pose=rigid(27, 300.0)),
}
"""Lenses and rasters of many kinds."""


def scaled(mesh: Mesh, factor: float) -> Mesh:
    """The same surface in another unit."""
    return Mesh(
        vertices=(mesh.vertices * np.float64(factor)).astype(np.float32), faces=mesh.faces, colours=mesh.colours
    )


def carried(mesh: Mesh, motion: np.ndarray) -> Mesh:
    """The same surface elsewhere."""
    vertices = mesh.vertices.astype(np.float64) @ motion[:3, :3].T + motion[:3, 3]
    return Mesh(vertices=vertices.astype(np.float32), faces=mesh.faces, colours=mesh.colours)


def relabelled(mesh: Mesh, seed: int) -> Mesh:
    """The same surface: vertices in another order, faces in another order, each from another of its corners."""
    random = np.random.default_rng(seed)
    order = random.permutation(len(mesh.vertices))
    place = np.argsort(order)
    faces = place[mesh.faces][random.permutation(len(mesh.faces))]
    start = random.integers(0, 3, len(faces))[:, None]
    faces = np.take_along_axis(faces, (start + np.arange(3)) % 3, 1)
    colours = None if mesh.colours is None else mesh.colours[order]
    return Mesh(vertices=mesh.vertices[order], faces=faces.astype(np.int32), colours=colours)


def extent(mesh: Mesh) -> float:
    """Largest coordinate, which bounds how finely float32 places the vertices."""
    return float(np.abs(mesh.vertices).max())
