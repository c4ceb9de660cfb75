"""New ids of a view's pixels: outlines of its masks where these are right, else by the pixels' own surface."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Int16, Int64
from torch import Tensor

from goc.priors.segmentation.id_field import IdField
from goc.priors.segmentation.surface_voxels import back_project, depth_of
from goc.scene import UNLABELLED, FrameSource

PART_OF_THING = 0.4
"""A mask covers a thing too if it has more than this share of what the view shows of it,"""
PART_OF_MASK = 0.25
"""or if the thing has more than this share of the mask. Less is the rim of its neighbours, drawn by voxels."""


def parts_of_masks(table: Int64[np.ndarray, "m k"], doubtful: Bool[np.ndarray, "m"]) -> Bool[np.ndarray, "m k"]:
    """Which things each mask of a view really covers, from the pixels (or voxels) that they share.

    Masks of which nothing is known are `doubtful`. Those that views confirmed, and what is unlabelled, cover a thing
    only if they cover much of what there is of it: noise of depth eats into thin things, and rims are left out on
    purpose.
    """
    counts = table.astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_thing = counts / counts.sum(0, keepdims=True)
        of_mask = counts / counts.sum(1, keepdims=True)
    return (counts > 0) & ((of_thing > PART_OF_THING) | (doubtful[:, None] & (of_mask > PART_OF_MASK)))


def relabelled(
    given: Int16[np.ndarray, "h w"], surface: Int16[np.ndarray, "h w"], known: dict[int, int]
) -> Int16[np.ndarray, "h w"]:
    """Ids of a view.

    Args:
        given: masks.
        surface: id of the surface at each pixel; UNLABELLED where unknown.
        known: new ids of masks of this view that other views confirmed.
    """
    masks, which = np.unique(given, return_inverse=True)
    things, what = np.unique(surface, return_inverse=True)
    which, what = which.reshape(given.shape), what.reshape(given.shape)
    table = np.bincount((which * len(things) + what).ravel(), minlength=len(masks) * len(things))
    table = table.reshape(len(masks), len(things))
    table[:, things == UNLABELLED] = 0
    confirmed = np.array([known.get(int(mask), UNLABELLED) for mask in masks])
    main = np.where((confirmed == UNLABELLED) & table.any(1), things[table.argmax(1)], confirmed)
    main[masks == UNLABELLED] = UNLABELLED
    parts = parts_of_masks(table, (masks != UNLABELLED) & (confirmed == UNLABELLED))
    return np.where(parts[which, what], things[what], main[which]).astype(np.int16)


@dataclass(frozen=True, kw_only=True, eq=False)
class RepairedIds:
    """New ids of a view, computed when it is asked for."""

    below: FrameSource
    field: IdField
    known: dict[int, dict[int, int]]
    """By view and given id: new ids of masks that show one thing."""

    def __call__(self, index: int) -> Int16[Tensor, "h w"]:
        """Ids of one view."""
        frame = self.below(index)
        shape = (frame.camera.height, frame.camera.width)
        surface, z = np.full(shape, UNLABELLED, np.int16), depth_of(frame)
        if z is not None:
            seen = np.isfinite(z)
            surface[seen] = self.field(back_project(z, frame.camera)[seen])
        given = np.full(shape, UNLABELLED, np.int16) if frame.ids is None else frame.ids.numpy()
        return torch.from_numpy(relabelled(given, surface, self.known.get(index, {})))
