"""Meshes in closed form, for what is measured of solids."""

from dataclasses import replace

import numpy as np

from assets import box_mesh
from goc.scene import Mesh


def cube(side=1.0, at=(0.0, 0.0, 0.0)) -> Mesh:
    """A closed cube with its least corner at `at`."""
    low = np.array(at, np.float64)
    return box_mesh(np.stack([low, low + side]))


def cuboid(low, high) -> Mesh:
    """A closed box."""
    return box_mesh(np.array([low, high], np.float64))


def sphere(radius=1.0, at=(0.0, 0.0, 0.0), rings=24) -> Mesh:
    """A closed sphere of latitude rings, counter-clockwise from outside; corners on the sphere."""
    polar = np.pi * np.arange(1, rings) / rings
    around = 2 * np.pi * np.arange(2 * rings) / (2 * rings)
    ring = np.stack(
        [
            np.outer(np.sin(polar), np.cos(around)),
            np.outer(np.sin(polar), np.sin(around)),
            np.outer(np.cos(polar), np.ones_like(around)),
        ],
        -1,
    )
    vertices = np.concatenate([[[0, 0, 1]], ring.reshape(-1, 3), [[0, 0, -1]]]) * radius + np.array(at)
    n = 2 * rings
    faces = []
    for k in range(n):
        after = (k + 1) % n
        faces.append((0, 1 + k, 1 + after))
        for row in range(rings - 2):
            a, b = 1 + row * n + k, 1 + row * n + after
            faces += [(a, a + n, b + n), (a, b + n, b)]
        faces.append((1 + (rings - 2) * n + k, len(vertices) - 1, 1 + (rings - 2) * n + after))
    return Mesh(vertices=vertices.astype(np.float32), faces=np.array(faces, np.int32))


def joined(*meshes: Mesh) -> Mesh:
    """Several meshes in one."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])[:-1]
    faces = [mesh.faces + np.int32(offset) for mesh, offset in zip(meshes, offsets, strict=True)]
    return Mesh(vertices=np.concatenate([mesh.vertices for mesh in meshes]), faces=np.concatenate(faces))


def unwelded(mesh: Mesh) -> Mesh:
    """The same triangles without common corners."""
    faces = np.arange(3 * len(mesh.faces), dtype=np.int32).reshape(-1, 3)
    return Mesh(vertices=np.ascontiguousarray(mesh.vertices[mesh.faces].reshape(-1, 3)), faces=faces)


def with_face_flipped(mesh: Mesh, face=0) -> Mesh:
    """One face turned round."""
    faces = mesh.faces.copy()
    faces[face] = faces[face][::-1]
    return replace(mesh, faces=faces)


def moved(mesh: Mesh, by) -> Mesh:
    """Shifted."""
    return replace(mesh, vertices=(mesh.vertices + np.array(by)).astype(np.float32))
