"""The small captures of tests/captures.py with ground truth: a box room with two boxes on its floor."""

from pathlib import Path

import numpy as np

from assets import box_mesh, inside_out
from captures import OBJECTS, ROOM_BOX, write_nerfstudio
from goc.evaluation.metrics import sample_surface
from goc.files import write_mesh
from goc.scene import Mesh

CRATE, CUPBOARD = (box_mesh(OBJECTS[number]) for number in (1, 2))
ROOM = inside_out(box_mesh(ROOM_BOX))


def write_truth(folder: Path, samples: int = 4000) -> Path:
    """A capture with gt/. Cameras saw everything but what faces the floor."""
    write_nerfstudio(folder)
    write_mesh(folder / "gt/room.ply", ROOM)
    arrays, seen = {}, []
    for number, mesh in {0: ROOM, 1: CRATE, 2: CUPBOARD}.items():
        points = sample_surface(mesh, samples if number else 60_000, seed=100 + number)
        if number:
            write_mesh(folder / f"gt/objects/{number}.ply", mesh)
            arrays[f"p{number}"] = points.points.astype(np.float32)
            arrays[f"n{number}"] = points.normals.astype(np.float16)
        keep = (points.normals[:, 2] > -0.5) if number else (points.points[:, 2] < 2.4)
        ids = np.full((keep.sum(), 1), number)
        seen.append(np.concatenate([points.points[keep], points.normals[keep], ids], axis=1))
    arrays["seen"] = np.concatenate(seen).astype(np.float32)
    np.savez(folder / "gt/points.npz", **arrays)
    return folder


def write_run(folder: Path, objects: dict[int, Mesh], scene: Mesh | None = None, name: str = "observed") -> Path:
    """An output folder of goc carve, as far as it is evaluated."""
    (folder / "objects").mkdir(parents=True, exist_ok=True)
    for number, mesh in objects.items():
        write_mesh(folder / f"objects/{number}/{name}.ply", mesh)
    if scene is not None:
        write_mesh(folder / "scene/mesh.ply", scene)
    return folder
