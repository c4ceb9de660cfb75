"""All surfaces of a room as one mesh, for ray casting and shading."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
from jaxtyping import Float, Float32, Int, Int16

from goc.geometry.raycast import RayHits, TriangleScene
from goc.synth.materials import Appearance, Material
from goc.synth.model import Model, ModelPart
from goc.synth.vectors import dot, length, unit

CREASE = np.cos(np.radians(40.0))
"""Faces that meet at a sharper angle keep their edge when shaded."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RoomSurfaces:
    """All triangles of a room, t of them, with the attributes that shading needs."""

    scene: TriangleScene
    owner: Int16[np.ndarray, "t"]
    """Object id; 0 = room."""
    material: Int16[np.ndarray, "t"]
    materials: tuple[Material, ...]
    face_normals: Float32[np.ndarray, "t 3"]
    normals: Float32[np.ndarray, "t 3 3"]
    """Shading normals of the corners, unit."""
    texture: Float32[np.ndarray, "t 3 3"]
    """Texture coordinates of the corners: positions in the frames of their materials, metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShadingPoints:
    """n points on surfaces, such as those that a camera's rays hit, with the attributes that shading needs."""

    positions: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    """Shading normals, unit."""
    face_normals: Float[np.ndarray, "n 3"]
    texture: Float[np.ndarray, "n 3"]
    triangle: Int[np.ndarray, "n"]

    def __getitem__(self, index: np.ndarray) -> "ShadingPoints":
        return ShadingPoints(
            positions=self.positions[index],
            normals=self.normals[index],
            face_normals=self.face_normals[index],
            texture=self.texture[index],
            triangle=self.triangle[index],
        )

    def __len__(self) -> int:
        return len(self.triangle)


def gather_surfaces(shell: Model, objects: dict[int, Model]) -> RoomSurfaces:
    """Cut all parts into triangles of at most 30 cm (the room: 45 cm), small enough to carry one brightness each."""
    pieces = [(0, item, 0.45) for item in shell.parts]
    pieces += [(key, item, 0.3) for key, model in objects.items() for item in model.parts]
    vertices, faces, owner, material, texture, normals, count = [], [], [], [], [], [], 0
    materials: list[Material] = []
    for key, item, longest in pieces:
        both, triangles = subdivided(np.concatenate([item.mesh.vertices, item.texture], -1), item.mesh.faces, longest)
        triangles = triangles[length(_areas(both[triangles, :3])) > 1e-12]  # no ray meets one without area
        vertices.append(both[:, :3])
        faces.append(triangles + count)
        texture.append(both[:, 3:][triangles])
        normals.append(corner_normals(both[:, :3], triangles, item))
        if item.material not in materials:
            materials.append(item.material)
        owner.append(np.full(len(triangles), key, np.int16))
        material.append(np.full(len(triangles), materials.index(item.material), np.int16))
        count += len(both)
    corners = np.concatenate(vertices)[np.concatenate(faces)]
    return RoomSurfaces(
        scene=TriangleScene(np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.int32)),
        owner=np.concatenate(owner),
        material=np.concatenate(material),
        materials=tuple(materials),
        face_normals=unit(_areas(corners)).astype(np.float32),
        normals=np.concatenate(normals).astype(np.float32),
        texture=np.concatenate(texture).astype(np.float32),
    )


def visible_points(
    surfaces: RoomSurfaces, hits: RayHits, positions: Float[np.ndarray, "n 3"], rays: Float[np.ndarray, "n 3"]
) -> ShadingPoints:
    """Points that rays hit, with normals turned towards the viewer, as open sheets are visible from both sides."""
    points = points_at_hits(surfaces, hits, positions)
    back = dot(points.face_normals, rays) > 0
    if not back.any():
        return points
    sign = np.where(back, -1.0, 1.0).astype(np.float32)[:, None]
    return replace(points, normals=sign * points.normals, face_normals=sign * points.face_normals)


def points_at_hits(surfaces: RoomSurfaces, hits: RayHits, positions: Float[np.ndarray, "n 3"]) -> ShadingPoints:
    """Points that rays hit; every ray must have hit something, as rays inside a closed room do."""
    weights = hits.barycentrics.astype(np.float32)
    triangle = hits.triangle
    return ShadingPoints(
        positions=positions,
        normals=unit(np.einsum("nk,nkc->nc", weights, surfaces.normals[triangle])),
        face_normals=surfaces.face_normals[triangle],
        texture=np.einsum("nk,nkc->nc", weights, surfaces.texture[triangle]),
        triangle=triangle,
    )


def triangle_centres(surfaces: RoomSurfaces) -> ShadingPoints:
    """The middle of every triangle."""
    count = len(surfaces.owner)
    third = RayHits(
        t=np.zeros(count), triangle=np.arange(count, dtype=np.int32), barycentrics=np.full((count, 3), 1 / 3)
    )
    middles = surfaces.scene.vertices[surfaces.scene.faces].mean(1, dtype=np.float64)
    return points_at_hits(surfaces, third, middles)


def appearance_at(surfaces: RoomSurfaces, points: ShadingPoints) -> Appearance:
    """Appearance of the materials at each point."""
    count = len(points)
    colour, glow, gloss = (
        np.zeros((count, 3), np.float32),
        np.zeros((count, 3), np.float32),
        np.zeros(count, np.float32),
    )
    material = surfaces.material[points.triangle]
    order = np.argsort(material, kind="stable")
    present, starts = np.unique(material[order], return_index=True)
    for index, chosen in zip(present, np.split(order, starts[1:]), strict=True):
        appearance = surfaces.materials[index].appearance(points.texture[chosen])
        colour[chosen], glow[chosen], gloss[chosen] = appearance.colour, appearance.glow, appearance.gloss
    return Appearance(colour=np.clip(colour, 0.0, 1.0), glow=glow, gloss=gloss)


def subdivided(
    vertices: Float[np.ndarray, "v k"], faces: Int[np.ndarray, "t 3"], longest: float
) -> tuple[Float[np.ndarray, "w k"], Int[np.ndarray, "s 3"]]:
    """Halve edges (of the first three coordinates) until none is longer, on both sides of an edge alike."""
    while True:
        ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], -1)
        lengths = np.linalg.norm(vertices[ends[..., 0], :3] - vertices[ends[..., 1], :3], axis=-1)
        worst = lengths.argmax(1)
        split = np.flatnonzero(lengths.max(1) > longest)
        if len(split) == 0:
            return vertices, faces.astype(np.int32)
        # Only edges that are the longest of some triangle are split, so that triangles do not become slivers.
        edges = np.unique(ends[split, worst[split]], axis=0)
        middle = {(int(a), int(b)): len(vertices) + i for i, (a, b) in enumerate(edges)}
        vertices = np.concatenate([vertices, 0.5 * (vertices[edges[:, 0]] + vertices[edges[:, 1]])])
        keys = ends[..., 0] * len(vertices) + ends[..., 1]
        touched = np.isin(keys, edges[:, 0] * len(vertices) + edges[:, 1]).any(1)
        pieces = [_split_face(face, middle) for face in faces[touched].tolist()]
        faces = np.concatenate([faces[~touched], np.array([piece for group in pieces for piece in group])])


def _split_face(face: list[int], middle: dict[tuple[int, int], int]) -> list[list[int]]:
    """A triangle cut at the middles of those of its edges that have one."""
    for turn in range(3):
        a, b, c = face[turn], face[(turn + 1) % 3], face[(turn + 2) % 3]
        at = middle.get((min(a, b), max(a, b)))
        if at is not None:
            return _split_face([a, at, c], middle) + _split_face([at, b, c], middle)
    return [face]


def corner_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"], item: ModelPart
) -> Float[np.ndarray, "t 3 3"]:
    """Mean normal, weighted by area, of the faces round each corner that are within the crease angle of its own."""
    areas = _areas(vertices[faces])
    own = unit(areas)
    if not item.smooth:
        return np.repeat(own[:, None], 3, 1)
    if item.scanned:  # a texture's seam is no edge
        faces = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)[faces]
    corner_face = np.repeat(np.arange(len(faces)), 3)
    ones = np.ones(len(corner_face))
    touches = scipy.sparse.csr_array((ones, (np.arange(len(ones)), faces.ravel())), (len(ones), len(vertices)))
    pairs = (touches @ touches.T).tocoo()
    near = dot(own[corner_face[pairs.row]], own[corner_face[pairs.col]]) > CREASE
    weights = scipy.sparse.csr_array((ones[:1].repeat(near.sum()), (pairs.row[near], pairs.col[near])), pairs.shape)
    return unit(weights @ areas[corner_face]).reshape(-1, 3, 3)


def _areas(corners: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3"]:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
