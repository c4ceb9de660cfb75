"""A folder of meshes in every format, with known faults, for tests of what reads them."""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from goc.files import write_mesh
from goc.scene import Mesh
from goc.synth.shapes import PartMesh, ball, cylinder, rounded_box

TEXTURE = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [200, 200, 200]]], np.uint8)
"""Upper left red, upper right green, lower left blue, lower right grey."""


def mesh_of(solid: PartMesh, colour=(200, 60, 60)) -> Mesh:
    """A solid as a coloured mesh."""
    colours = np.broadcast_to(np.array(colour, np.uint8), solid.vertices.shape)
    return Mesh(
        vertices=solid.vertices.astype(np.float32), faces=solid.faces.astype(np.int32), colours=np.array(colours)
    )


def joined(*solids: PartMesh) -> PartMesh:
    """Several solids as one."""
    starts = np.cumsum([0] + [len(solid.vertices) for solid in solids])
    faces = [solid.faces + start for solid, start in zip(solids, starts, strict=False)]
    return PartMesh(vertices=np.concatenate([solid.vertices for solid in solids]), faces=np.concatenate(faces))


def table(width=1.1, depth=0.7, height=0.7) -> PartMesh:
    """A plate on four legs."""
    legs = [
        cylinder(0.03, height - 0.04).moved(sx * (width / 2 - 0.05), sy * (depth / 2 - 0.05))
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return joined(rounded_box((width, depth, 0.04)).moved(z=height - 0.04), *legs)


def chair() -> PartMesh:
    """A seat on a block, with a back towards +x."""
    return joined(rounded_box((0.42, 0.42, 0.44)), rounded_box((0.05, 0.42, 0.46)).moved(x=0.185, z=0.441))


def textured_box(size=(0.2, 0.16, 0.12)) -> trimesh.Trimesh:
    """A box on z = 0 whose every side shows the whole of TEXTURE: vertices are repeated at its edges."""
    box = trimesh.creation.box(size)
    corners = box.vertices[box.faces].reshape(-1, 3)
    axis = np.abs(np.repeat(box.face_normals, 3, axis=0)).argmax(1)
    flat = np.stack([corners[np.arange(36), (axis + 1) % 3], corners[np.arange(36), (axis + 2) % 3]], -1)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(TEXTURE))
    visual = trimesh.visual.TextureVisuals(uv=(flat > 0).astype(float), material=material)
    return trimesh.Trimesh(
        corners + np.array([0, 0, size[2] / 2]), np.arange(36).reshape(-1, 3), visual=visual, process=False
    )


def write_folder(folder: Path) -> Path:
    """Two tables, a chair, seven small things, and four files that are of no use."""
    (folder / "deep" / "er").mkdir(parents=True)
    write_mesh(folder / "table.ply", mesh_of(table(), (150, 100, 50)))
    trimesh.Trimesh(*_arrays(table(0.9, 0.9, 0.45)), process=False).export(folder / "deep" / "low.glb")
    write_mesh(folder / "chair.ply", mesh_of(chair(), (40, 90, 160)))
    textured_box().export(folder / "deep" / "box.glb")
    textured_box((0.3, 0.1, 0.2)).export(folder / "deep" / "er" / "parcel.obj")
    for index in range(5):
        solid = rounded_box((0.1 + 0.02 * index, 0.09, 0.08), 0.01, 3)
        write_mesh(folder / f"block{index}.ply", mesh_of(solid, (60 + 30 * index, 160, 90)))
    write_mesh(folder / "ball.ply", mesh_of(ball(0.07, 16)))
    write_mesh(folder / "mast.ply", mesh_of(cylinder(0.05, 1.4)))
    write_mesh(folder / "hall.ply", mesh_of(rounded_box((30.0, 20.0, 9.0))))
    (folder / "broken.glb").write_bytes(b"glTF, but not really")
    (folder / "notes.txt").write_text("no mesh")
    return folder


def _arrays(solid: PartMesh):
    return solid.vertices, solid.faces
