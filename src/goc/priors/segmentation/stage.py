"""Capture → the same capture with ids: things told apart by geometry alone."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Int16
from torch import Tensor

from goc.events import Listener, Warned, ignore
from goc.priors.segmentation.cluster import find_objects
from goc.priors.segmentation.config import SegmentConfig
from goc.priors.segmentation.id_field import IdField
from goc.priors.segmentation.room_planes import find_room_planes
from goc.priors.segmentation.surface_voxels import back_project, by_name, depth_of, fuse_depth, thinned
from goc.scene import ROOM, UNLABELLED, Capture, Frame, FrameSource, ViewCache

REACH = (2.0, 4.0)
"""A pixel's point may lie three noises off the surface, but at least and at most so many voxels."""
CACHE_BYTES = 64 << 20
"""Id images kept, all views together."""


def segment(views: Capture, config: SegmentConfig, notify: Listener = ignore) -> Capture:
    """Give every view ids found by geometry: room 0, objects 1… by falling size, -1 where nothing is known.

    Depth of all views is fused into one surface; floor, walls and ceiling are planes of it; what stands on or before
    them is parted into connected things, and those that stand on a table, counter or shelf from it and from each
    other. The id of a pixel is that of its 3D point, so views agree by construction. Ids that the capture had are
    replaced. They are computed when a view is loaded.

    Args:
        views: with depth in at least one view. Any scale (`units_per_metre`), any up direction, any order of views.
        config: settings.
        notify: hears of progress, and of a capture in which nothing but room is found.

    Raises:
        SegmentError: no view has depth, or no surface shows in it.
    """
    surface = thinned(fuse_depth(views, config, notify))
    rng = np.random.default_rng(config.seed)
    cameras = tuple(views.cameras[index] for index in by_name(views))  # sums do not depend on the order of views
    room = find_room_planes(surface, cameras, views.units_per_metre, rng)
    things = find_objects(surface, room, config, views.units_per_metre, rng)
    if not (things.ids > 0).any():
        message = f"{len(views)} views show nothing but room: no object was found. Give masks to name objects yourself."
        notify(Warned(stage="segment", message=message))
    reach = float(np.clip(3.0 * room.noise / surface.voxel, *REACH))
    field = IdField(surface, things.ids, reach)
    frames = SegmentedFrames(below=views.frames, ids=ViewCache(FieldIds(below=views.frames, field=field), CACHE_BYTES))
    return replace(views, frames=frames, has_ids=True, id_names={ROOM: "room", **things.id_names})


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldIds:
    """Ids of a view's pixels: those of their points in the field."""

    below: FrameSource
    field: IdField

    def __call__(self, index: int) -> Int16[Tensor, "h w"]:
        """Ids of one view; UNLABELLED where there is no depth."""
        frame = self.below(index)
        ids = np.full((frame.camera.height, frame.camera.width), UNLABELLED, np.int16)
        z = depth_of(frame)
        if z is not None:
            seen = np.isfinite(z)
            ids[seen] = self.field(back_project(z, frame.camera)[seen])
        return torch.from_numpy(ids)


@dataclass(frozen=True, kw_only=True, eq=False)
class SegmentedFrames:
    """The views of another source, with the ids that were found."""

    below: FrameSource
    ids: ViewCache[Tensor]

    def __call__(self, index: int) -> Frame:
        """One view."""
        return replace(self.below(index), ids=self.ids(index).clone())
