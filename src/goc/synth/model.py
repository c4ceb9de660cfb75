"""Models of objects: parts with materials, and the flat tops that other objects can stand on."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from goc.files.any_mesh import welded
from goc.files.colour import encode_srgb
from goc.scene import Mesh
from goc.synth.materials import Material
from goc.synth.shapes import PartMesh


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelPart:
    """One triangle mesh of one material; closed, unless it is scanned."""

    mesh: PartMesh
    material: Material
    texture: Float[np.ndarray, "v 3"]
    """Coordinates of each vertex in the frame of its material, metres; unchanged when the part is moved."""
    smooth: bool = True
    """Shade across edges that are nearly flat, as on turned or upholstered things."""
    scanned: bool = False
    """It was read from a file: vertices may be repeated at a texture's seams, and it need not be closed."""


@dataclass(frozen=True, kw_only=True)
class Top:
    """A flat horizontal rectangle that other objects can stand on, metres."""

    x: float
    y: float
    z: float
    width: float
    depth: float
    clearance: float = np.inf
    """Free height above it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """An object: its parts, in its own frame (base on z = 0, front towards -y) or in the world, metres."""

    name: str
    parts: tuple[ModelPart, ...]
    tops: tuple[Top, ...] = ()

    def moved(self, x: float, y: float, z: float = 0.0) -> "Model":
        """The thing, shifted."""
        parts = tuple(replace(part, mesh=part.mesh.moved(x, y, z)) for part in self.parts)
        return Model(name=self.name, parts=parts)

    def turned(self, angle: float) -> "Model":
        """The thing, rotated about the vertical axis, radians counter-clockwise."""
        parts = tuple(replace(part, mesh=part.mesh.turned("z", angle)) for part in self.parts)
        return Model(name=self.name, parts=parts)

    @property
    def bounds(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Lowest and highest corner of the axis-parallel box."""
        points = np.concatenate([part.mesh.vertices for part in self.parts])
        return points.min(0), points.max(0)


def make_part(mesh: PartMesh, material: Material, variant: int = 0, smooth: bool = True) -> ModelPart:
    """A mesh made of a material; `variant` shifts the pattern, so that equal boards do not look the same."""
    shift = variant * np.array([1.37, 2.11, 1.73])
    return ModelPart(mesh=mesh, material=material, texture=mesh.vertices + shift, smooth=smooth)


def placed(item: ModelPart, x: float | int = 0, y: float | int = 0, z: float | int = 0) -> ModelPart:
    """The part, shifted; its pattern goes along."""
    return replace(item, mesh=item.mesh.moved(x, y, z))


def tilted(item: ModelPart, axis: str, angle: float) -> ModelPart:
    """The part, rotated about a coordinate axis through the origin; its pattern goes along."""
    return replace(item, mesh=item.mesh.turned(axis, angle))


def mesh_of(model: Model) -> Mesh:
    """All parts as one mesh, with the materials' colours at the vertices; scanned ones are welded."""
    vertices, faces, colours, count = [], [], [], 0
    for item in model.parts:
        vertices.append(item.mesh.vertices)
        faces.append(item.mesh.faces + count)
        colours.append(item.material.appearance(item.texture).colour)
        count += len(item.mesh.vertices)
    mesh = Mesh(
        vertices=np.concatenate(vertices).astype(np.float32),
        faces=np.concatenate(faces).astype(np.int32),
        colours=encode_srgb(np.concatenate(colours)),
    )
    return welded(mesh) if any(item.scanned for item in model.parts) else mesh
