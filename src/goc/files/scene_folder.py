"""Writes a scene into a folder and reads it back without loss; layout.py has the names of the files."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import Int16
from torch import Tensor

from goc.errors import FileError
from goc.files import layout
from goc.files.documents import read_versioned, write_json
from goc.files.evidence import read_evidence, write_evidence
from goc.files.layout import object_files, object_ids
from goc.files.meshes import read_mesh, read_observed_mesh, write_mesh
from goc.files.reading import is_file
from goc.files.scene_entries import (
    VERSION,
    ObjectEntry,
    SceneEntry,
    WorldEntry,
    camera_of,
    completed_of,
    contact_of,
    entry_of,
    plane_of,
    world_of,
)
from goc.files.splats import read_splats, write_splats
from goc.files.tensors import read_tensors, write_tensors
from goc.scene import UNLABELLED, FlaggedMesh, Gaussians, Mesh, Scene, SceneObject, World

SurfaceKind = Literal["observed", "solid"]

_AGAIN = "Carve again with --overwrite"


def write_scene(folder: Path, scene: Scene) -> None:
    """Write a whole scene in the world and units of the capture; scene.json is written last.

    Each file is written atomically, but the folder is not: runs write into a temporary folder (`goc.runs`).

    Args:
        folder: created if it does not exist; existing files of the same names are replaced.
        scene: the splats of each object have to be those labelled with its id, as they are read back so.

    Raises:
        FileError: a number is not finite, or a file cannot be written.
    """
    write_meshes(folder, scene.mesh, scene.objects)
    write_splats(folder / layout.SCENE_SPLATS, scene.splats)
    tensors = {"labels": scene.labels}
    if scene.splats.identity is not None:
        tensors["identity"] = scene.splats.identity
    write_tensors(folder / layout.SCENE_LABELS, tensors)
    for item in scene.objects:
        own = object_files(folder, item.id)
        if item.splats is not None:
            write_splats(own.splats, item.splats)
        if item.evidence is not None:
            write_evidence(own.evidence, item.evidence)
    write_json(folder / layout.SCENE, entry_of(scene))


def write_meshes(folder: Path, mesh: Mesh, objects: Sequence[SceneObject]) -> None:
    """Write only the meshes: that of the scene, and the surfaces that each object has."""
    write_mesh(folder / layout.SCENE_MESH, mesh)
    for item in objects:
        own = object_files(folder, item.id)
        for path, surface in ((own.observed, item.observed), (own.solid, item.solid)):
            if surface is not None:
                write_mesh(path, surface.mesh, surface.observed)


def read_scene(folder: Path) -> Scene:
    """Read the output folder of `goc carve`, or what `write_scene` wrote.

    Raises:
        FileError: no scene is there, its schema is of another version, or a file is missing, damaged or contradicts
            another.
    """
    entry = _read_entry(folder)
    splats, labels = _read_splats(folder)
    return Scene(
        splats=splats,
        labels=labels,
        mesh=read_mesh(folder / layout.SCENE_MESH),
        objects=tuple(_read_object(folder, item, splats, labels) for item in entry.objects),
        cameras={item.name: camera_of(item) for item in entry.cameras},
        world=_read_world(folder / layout.SCENE, entry.world),
        metrics={name: np.nan if value is None else value for name, value in entry.metrics.items()},
        settings=entry.settings,
    )


def read_meshes(folder: Path, wanted: Sequence[SurfaceKind]) -> dict[int, tuple[SurfaceKind, Mesh]]:
    """Read one mesh of each object, the first of the wanted surfaces that it has, and nothing else of the scene.

    Without scene.json, the objects are the folders under objects/.

    Returns:
        Kind and mesh by ascending id; objects with none of the surfaces are left out.

    Raises:
        FileError: scene.json is of another version or contradicts itself, or a mesh is missing or damaged.
    """
    found: dict[int, tuple[SurfaceKind, Mesh]] = {}
    for id, surfaces in _surfaces(folder).items():
        kind = next((kind for kind in wanted if kind in surfaces), None)
        if kind is not None:
            found[id] = kind, read_mesh(getattr(object_files(folder, id), kind))
    return found


def _surfaces(folder: Path) -> dict[int, set[SurfaceKind]]:
    """Surfaces of each object by id, from scene.json, or from the existing files if there is none."""
    kinds: tuple[SurfaceKind, ...] = ("observed", "solid")
    if is_file(folder / layout.SCENE):
        return {item.id: {kind for kind in kinds if getattr(item, kind)} for item in _read_entry(folder).objects}
    return {
        id: {kind for kind in kinds if is_file(getattr(object_files(folder, id), kind))} for id in object_ids(folder)
    }


def _read_entry(folder: Path) -> SceneEntry:
    path = folder / layout.SCENE
    entry = read_versioned(path, SceneEntry, VERSION, _AGAIN)
    ids, names = [item.id for item in entry.objects], [item.name for item in entry.cameras]
    if ids != sorted(set(ids)):
        raise FileError(f"{path}: the ids of its {len(ids)} objects do not ascend. {_AGAIN}.")
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise FileError(f"{path}: {len(doubled)} names belong to several cameras (first: {doubled[0]}). {_AGAIN}.")
    return entry


def _read_world(path: Path, entry: WorldEntry) -> World:
    if not abs(np.linalg.norm(entry.up) - 1) < 1e-6:
        raise FileError(f"{path}: world.up {entry.up} is not of length 1. {_AGAIN}.")
    world = world_of(entry)
    if not np.allclose(world.level_from_world, entry.level_from_world, rtol=1e-6, atol=1e-9):
        raise FileError(f"{path}: world.level_from_world is not what up, floor and units_per_metre give. {_AGAIN}.")
    return world


def _read_splats(folder: Path) -> tuple[Gaussians, Int16[Tensor, "n"]]:
    path = folder / layout.SCENE_LABELS
    splats, (tensors, _) = read_splats(folder / layout.SCENE_SPLATS), read_tensors(path)
    labels, identity = tensors.get("labels"), tensors.get("identity")
    if labels is None or labels.dtype != torch.int16 or labels.ndim != 1:
        raise FileError(f"{path}: holds no labels of splats. {_AGAIN}.")
    if len(labels) != len(splats) or (identity is not None and (identity.ndim != 2 or len(identity) != len(splats))):
        raise FileError(f"{path}: {len(labels)} labels for {len(splats)} splats in {layout.SCENE_SPLATS}. {_AGAIN}.")
    if (labels < UNLABELLED).any():
        raise FileError(f"{path}: {int((labels < UNLABELLED).sum())} labels are below {UNLABELLED}. {_AGAIN}.")
    return (splats if identity is None else replace(splats, identity=identity)), labels


def _read_object(folder: Path, entry: ObjectEntry, splats: Gaussians, labels: Int16[Tensor, "n"]) -> SceneObject:
    own = object_files(folder, entry.id)
    if entry.splats and not is_file(own.splats):
        raise FileError(f"{own.splats}: not found, but {layout.SCENE} lists it. {_AGAIN}.")
    return SceneObject(
        id=entry.id,
        name=entry.name,
        world_from_object=np.array(entry.world_from_object, np.float64),
        splats=splats[labels == entry.id] if entry.splats else None,
        observed=_read_surface(own.observed) if entry.observed else None,
        solid=_read_surface(own.solid) if entry.solid else None,
        evidence=read_evidence(own.evidence) if entry.evidence else None,
        contact=None if entry.contact is None else contact_of(entry.contact),
        completed=None if entry.completed is None else completed_of(entry.completed),
        walls=tuple(plane_of(plane) for plane in entry.walls),
    )


def _read_surface(path: Path) -> FlaggedMesh:
    mesh, observed = read_observed_mesh(path)
    return FlaggedMesh(mesh=mesh, observed=observed)
