"""What a carve of the small captures would hand over, in closed form: boxes as meshes, a few splats on them."""

from dataclasses import replace

import numpy as np
import torch

from cameras import pinhole
from captures import OBJECTS, ROOM_BOX
from goc.scene import EvidenceGrid, FlaggedMesh, Gaussians, Mesh, Reconstruction, Scene, SceneObject, World

# Corners are numbered by the bits of (x, y, z); seen from outside each side turns counter-clockwise.
_SIDES = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]


def box_mesh(box, colour=(200, 120, 60)) -> Mesh:
    """A closed box, counter-clockwise from outside."""
    corners = np.array([[box[n & 1, 0], box[n >> 1 & 1, 1], box[n >> 2, 2]] for n in range(8)], np.float32)
    faces = [(a, b, c) for a, b, c, _ in _SIDES] + [(a, c, d) for a, _, c, d in _SIDES]
    return Mesh(vertices=corners, faces=np.array(faces, np.int32), colours=np.full((8, 3), colour, np.uint8))


def inside_out(mesh: Mesh) -> Mesh:
    """The same surface seen from the other side, as a room is."""
    return replace(mesh, faces=np.ascontiguousarray(mesh.faces[:, ::-1]))


def box_object(number: int, name: str, box, splats=None) -> SceneObject:
    """A box of which the corners at the bottom were never seen."""
    mesh = box_mesh(box)
    seen = mesh.vertices[:, 2] > mesh.vertices[:, 2].min()
    state = np.array([[[0, 1], [2, 0]], [[2, 1], [0, 0]]], np.uint8)
    sdf = np.where(state == 2, np.float32(0.03), np.float32(0))
    grid = EvidenceGrid(origin=box[0].astype(float), voxel=0.1, state=state, sdf=sdf)
    surface = FlaggedMesh(mesh=mesh, observed=seen)
    return SceneObject(id=number, name=name, observed=surface, evidence=grid, splats=splats)


def box_splats(ids=(1, 2)) -> Reconstruction:
    """Ten splats in each of the two boxes of tests/captures.py, numbered as asked, and ten in their room."""
    boxes = list(OBJECTS.values())
    generator = torch.Generator().manual_seed(0)
    means, numbers = [], []
    for number, box in zip((0, *ids), (ROOM_BOX, *boxes), strict=True):
        low, high = torch.from_numpy(box).float()
        means.append(low + (high - low) * torch.rand(10, 3, generator=generator))
        numbers += [number] * 10
    positions = torch.cat(means)
    splats = Gaussians(
        means=positions,
        quats=torch.tensor([1.0, 0, 0, 0]).repeat(len(positions), 1),
        log_scales=torch.full((len(positions), 3), -2.0),
        opacity_logits=torch.full((len(positions),), 4.0),
        sh=torch.rand(len(positions), 4, 3, generator=generator),
    )
    return Reconstruction(
        gaussians=splats,
        labels=torch.tensor(numbers, dtype=torch.int16),
        metrics={"held_out_psnr_db": 21.5, "train_psnr_db": float("nan")},
    )


def box_scene(ids=(1, 2), units_per_metre=1.0) -> Scene:
    """The room of tests/captures.py with its two boxes and their splats, numbered as asked."""
    made = box_splats(ids)
    splats, labels = made.gaussians, made.labels
    camera = pinhole((50.1, 50.2), (64, 48), (32.3, 24.4))
    return Scene(
        splats=splats,
        labels=labels,
        mesh=inside_out(box_mesh(ROOM_BOX, (210, 205, 190))),
        objects=tuple(
            box_object(n, f"box {n}", box, splats[labels == n]) for n, box in zip(ids, OBJECTS.values(), strict=True)
        ),
        cameras={"images/1.png": camera},
        world=World(
            up=np.array([0.0, 0.0, 1.0]), floor=0.0, confidence=0.9, units_per_metre=units_per_metre, metric=True
        ),
        metrics=made.metrics,
    )
