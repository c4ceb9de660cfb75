"""Faults of instance masks as networks make them: swapped, missing, too large or too small."""

import numpy as np
import scipy.ndimage
from jaxtyping import Int16

from goc.scene import ROOM, UNLABELLED

Ids = Int16[np.ndarray, "h w"]
Rng = np.random.Generator

_REACH_PX = (2, 6)
"""Least and greatest number of pixels by which a mask grows or shrinks."""


def corrupt_masks(ids: Ids, share: float, rng: Rng) -> Ids:
    """Corrupt a share of the objects' masks in one view.

    A mask is all pixels of one object (id 1 or more) in the view. Of n masks, share·n are chosen at random; a fraction
    is rounded up or down at random, so that the mean over views is right. One of these happens to each, equally likely:

    - swapped: with equal chance, the mask and that of its neighbour exchange their ids, or the mask takes the
      neighbour's id and its own is gone from the view. The neighbour is the object that shares most border with it, or
      where it touches none, the one whose pixels are nearest. In an exchange the neighbour's mask is corrupted too, in
      addition to the share. Where there is no other object, the mask is dropped instead.
    - dropped: with equal chance, its pixels become unlabelled, or room.
    - resized: with equal chance it is dilated, and takes all pixels up to r away, or eroded, and gives its pixels less
      than r from its rim to whatever lies nearest outside. r is 2 to 6 pixels, drawn anew each time.

    Pixels that are unlabelled count as outside. Masks are corrupted one after the other, smallest id first.
    """
    present = np.unique(ids[ids > ROOM])
    count = int(share * len(present) + rng.random())
    result = ids.copy()
    for key in np.sort(rng.permutation(present)[:count]):
        mask = result == key
        if not mask.any():  # the neighbour's id swallowed it
            continue
        effect, second, radius = rng.integers(3), rng.random() < 0.5, int(rng.integers(_REACH_PX[0], _REACH_PX[1] + 1))
        neighbour = nearest_object(result, mask)
        if effect == 0 and neighbour is not None:
            other = result == neighbour
            result[mask] = neighbour
            if second:
                result[other] = key
        elif effect == 2:
            result = dilated(result, mask, radius) if second else eroded(result, mask, radius)
        else:
            result[mask] = UNLABELLED if second else ROOM
    return result


def nearest_object(ids: Ids, mask: np.ndarray) -> int | None:
    """The object that shares most border with a mask, else the nearest one; None where there is no other."""
    rim = scipy.ndimage.binary_dilation(mask) & ~mask
    for candidates in (ids[rim], None):
        if candidates is None:
            away = scipy.ndimage.distance_transform_edt(~mask)
            away[mask | (ids <= ROOM)] = np.inf
            place = np.unravel_index(away.argmin(), away.shape)
            return int(ids[place]) if np.isfinite(away[place]) else None
        touching = candidates[candidates > ROOM]
        if len(touching):
            return int(np.bincount(touching).argmax())
    return None


def dilated(ids: Ids, mask: np.ndarray, radius: int) -> Ids:
    """The mask takes all pixels whose centre is at most `radius` from one of its own."""
    away = scipy.ndimage.distance_transform_edt(~mask)
    return np.where(away <= radius, ids[mask][0], ids)


def eroded(ids: Ids, mask: np.ndarray, radius: int) -> Ids:
    """The mask keeps its pixels at least `radius` from the nearest outside one; the others become like that one."""
    if mask.all():
        return ids
    away, nearest = scipy.ndimage.distance_transform_edt(mask, return_indices=True)
    return np.where(mask & (away < radius), ids[tuple(nearest)], ids)
