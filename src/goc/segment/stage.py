"""Capture → the same capture with ids: things told apart by geometry alone."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Int16
from torch import Tensor

from goc.events import Listener, Warned, ignore
from goc.scene import UNLABELLED, Capture, Frame
from goc.segment.cluster import Things, find_things
from goc.segment.config import SegmentConfig
from goc.segment.fuse import back_project, depth_of, fuse, thinned
from goc.segment.lookup import IdField
from goc.segment.room import find_room

CACHE_BYTES = 64 << 20


def segment(views: Capture, config: SegmentConfig, notify: Listener = ignore) -> Capture:
    surface = thinned(fuse(views, config, notify))
    rng = np.random.default_rng(config.seed)
    room = find_room(surface, views.cameras, views.unit, rng)
    things = find_things(surface, room, config, views.unit, rng)
    if not (things.ids > 0).any():
        notify(Warned(stage="segment", message="nothing but room was found"))
    field = IdField(surface, things.ids, max(2.0, min(3.0 * room.noise / surface.voxel, 4.0)))
    return _labelled(views, field, things)


def _labelled(views: Capture, field: IdField, things: Things) -> Capture:
    size = max((2 * camera.width * camera.height for camera in views.cameras), default=1)

    @lru_cache(maxsize=max(1, CACHE_BYTES // size))
    def ids_of(index: int) -> Int16[Tensor, "h w"]:
        camera = views.cameras[index]
        ids = np.full((camera.height, camera.width), UNLABELLED, np.int16)
        z = depth_of(views, index)
        if z is not None:
            seen = np.isfinite(z)
            ids[seen] = field(back_project(z, camera)[seen])
        return torch.from_numpy(ids)

    def load(index: int) -> Frame:
        return replace(views.load(index), ids=ids_of(index).clone())

    return replace(views, load=load, has_ids=True, labels={0: "room", **things.names})
