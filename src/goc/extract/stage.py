"""Splats and their views in, a scene of open objects out."""

from dataclasses import replace

import torch

from goc.device import CPU
from goc.events import Listener, Warned, ignore
from goc.extract.agreement import views_noise
from goc.extract.config import ExtractConfig, WorldConfig
from goc.extract.fuse import fuse_scene
from goc.extract.objects import extract_objects
from goc.extract.world import find_world
from goc.scene import ROOM, Capture, Reconstruction, Scene


def extract_scene(
    splats: Reconstruction,
    views: Capture,
    config: ExtractConfig,
    world: WorldConfig,
    notify: Listener = ignore,
    device: torch.device = CPU,
) -> Scene:
    """Mesh the scene and every object in it, and find the scene's world.

    Args:
        splats: what the scene is made of; each object gets those of its id.
        views: photographs with depth and ids (`measured_views`).
        config: voxels, votes and the evidence boxes.
        world: up and floor, where the user knows them.
        notify: hears progress and warnings.
        device: where views are fused.

    Returns:
        Open objects with evidence, ascending ids, in the capture's world and units; nothing is closed yet.

    Raises:
        ExtractError: no view has ids or depth, or no surface is left.
    """
    noise = views_noise(views)
    mesh = fuse_scene(views, config, notify, device, noise)
    objects = extract_objects(views, config, notify, device, noise)
    if not objects:
        notify(Warned(stage="extract", message=_nothing_found(views)))
    return Scene(
        splats=splats.gaussians,
        labels=splats.labels,
        mesh=mesh,
        objects=tuple(replace(item, splats=splats.gaussians[splats.labels == item.id]) for item in objects),
        cameras=dict(zip(views.view_names, views.cameras, strict=True)),
        world=find_world(mesh, views, world, notify),
        metrics=dict(splats.metrics),
    )


def _nothing_found(views: Capture) -> str:
    """Why there may be no object, and what to try."""
    numbers = {int(number) for index in range(len(views)) for number in _ids_in(views, index)}
    if not numbers:
        return "No object was found: no view has an id above 0. Give ids, or let goc find things: --capture.no-use-ids."
    few = ", ".join(map(str, sorted(numbers)[:6]))
    return f"No object was found: ids {few} have no surface that enough views agree on. Look at overview.png."


def _ids_in(views: Capture, index: int) -> list[int]:
    ids = views[index].ids
    return [] if ids is None else ids[ids > ROOM].unique().tolist()
