"""Id images of any coding → ids: what their values mean is found out once a capture, from a few views."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int16, Shaped

from goc.capture.pixels import Pixels, codes_in, path_of
from goc.capture.source import IdCodes
from goc.errors import CaptureError
from goc.events import Listener, Warned
from goc.scene import ROOM, UNLABELLED

_LOOKED_AT = 16
_MOST_IDS = 32767
_MOST_COLOURS = 2000
_MIXED = 0.15
"""Share of id changes along rows that pass through a value between the two: smoothing leaves one at nearly every
change, clean ids of things that touch leave few."""
_BLOCK = 3


def ids_of(path: Path, stored: Shaped[np.ndarray, "h w"], codes: IdCodes) -> Int16[np.ndarray, "h w"]:
    """What stored values mean.

    Raises:
        CaptureError: an id is beyond 32767.
    """
    if codes.table and codes.table[-1][0] >= 1 << 16:
        stored = _as_colours(stored)
    values = stored.astype(np.int32)
    unlabelled = np.iinfo(stored.dtype).max if stored.dtype in (np.uint8, np.uint16) else None
    ids = _by_table(values, codes, unlabelled) if codes.table else _by_rule(values, codes, unlabelled)
    if ids.size and ids.max() > _MOST_IDS:
        raise CaptureError(f"{path}: holds id {ids.max()}, beyond {_MOST_IDS}. Number the objects from 1.")
    if codes.blurred:
        ids = np.where(_within_blocks(values), ids, UNLABELLED)
    return ids.astype(np.int16)


def _by_rule(values: np.ndarray, codes: IdCodes, unlabelled: int | None) -> np.ndarray:
    ids = values.copy()
    if unlabelled is not None:
        ids[values == unlabelled] = UNLABELLED
    ids[values == codes.background] = UNLABELLED if codes.room else ROOM
    ids[np.isin(values, codes.room)] = ROOM
    if codes.unknown is not None:
        ids[values == codes.unknown] = UNLABELLED
    if codes.values:
        ids[~np.isin(values, codes.values)] = UNLABELLED
    return ids


def _by_table(values: np.ndarray, codes: IdCodes, unlabelled: int | None) -> np.ndarray:
    stored, ids = np.array(sorted(codes.table), np.int64).T
    at = np.searchsorted(stored, values).clip(0, len(stored) - 1)
    others = codes.others if unlabelled is None else np.where(values == unlabelled, UNLABELLED, codes.others)
    return np.where(stored[at] == values, ids[at], others)


def _within_blocks(values: np.ndarray) -> Bool[np.ndarray, "h w"]:
    """Pixels that some block of equal values covers."""
    if min(values.shape) < _BLOCK:
        return np.zeros(values.shape, bool)
    windows = np.lib.stride_tricks.sliding_window_view(values, (_BLOCK, _BLOCK))
    uniform = windows.max((-1, -2)) == windows.min((-1, -2))
    kept = np.zeros(values.shape, bool)
    for down in range(_BLOCK):
        for across in range(_BLOCK):
            kept[down : down + uniform.shape[0], across : across + uniform.shape[1]] |= uniform
    return kept


def understood(where: Path, images: Sequence[Pixels], codes: IdCodes, notify: Listener) -> IdCodes:
    """Look at some id images, and tell what their values mean where the capture does not say.

    Colours get ids in ascending order, black is the room. Images of nothing but 0 and 255 hold one thing, id 1.
    Images that were scaled with smoothing lose the mixed values at their edges.

    Args:
        where: of the capture, for errors.
        images: of all views that have ids.
        codes: as the reader knows them; where it has a table, that stays.
        notify: hears what was concluded.

    Raises:
        CaptureError: colours by the thousand, which no ids are.
        FileError: an image is damaged.
    """
    step = -(-len(images) // _LOOKED_AT)
    sample = [codes_in(image) for image in images[::step]]
    if not codes.table:
        if any(stored.dtype == np.int32 and stored.size and stored.max() >= 1 << 16 for stored in sample):
            codes = _coloured(where, images, codes, notify)
        elif _is_binary(sample, codes):
            text = "Id images hold nothing but 0 and 255: 255 is taken for one object, id 1"
            notify(Warned(stage="capture", message=text))
            codes = replace(codes, table=((0, ROOM), (255, 1)))
    if _mixed_share(sample) > _MIXED:
        text = "Id images were scaled with smoothing: values mixed at edges are left out. Scale ids with nearest."
        notify(Warned(stage="capture", message=text))
        codes = replace(codes, blurred=True)
    return codes


def _is_binary(sample: list[np.ndarray], codes: IdCodes) -> bool:
    if codes.background or codes.unknown == 255 or codes.values:
        return False
    found = set().union(*(np.unique(stored).tolist() for stored in sample if stored.dtype == np.uint8))
    return found == {0, 255} and all(stored.dtype == np.uint8 for stored in sample)


def _coloured(where: Path, images: Sequence[Pixels], codes: IdCodes, notify: Listener) -> IdCodes:
    """Number the colours of all views; those that only mixed edges have are left out."""
    colours: set[int] = set()
    for image in images:
        stored = _as_colours(codes_in(image))
        colours |= set(np.unique(stored[_within_blocks(stored)]).tolist())
        if len(colours) > _MOST_COLOURS:
            raise CaptureError(
                f"{where}: id images hold more than {_MOST_COLOURS} colours (at {path_of(image).name}), so they are no"
                " ids, or JPEG blurred them. Write one colour an object, as PNG."
            )
    things = sorted(colours - {0})
    text = f"Id images are coloured: {len(things)} colours became ids 1 to {len(things)}, black is the room"
    notify(Warned(stage="capture", message=text))
    return replace(codes, table=((0, ROOM), *((colour, number) for number, colour in enumerate(things, 1))))


def _as_colours(stored: np.ndarray) -> np.ndarray:
    """Grey values of an image that happens to have no colour, as colours."""
    return stored.astype(np.int32) * 0x010101 if stored.dtype == np.uint8 else stored


def _mixed_share(sample: list[np.ndarray]) -> float:
    """Share of changes along rows that pass through a value between those before and after."""
    changes, mixed = 0, 0
    for stored in sample:
        values = stored.astype(np.int64)
        before, here, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
        changed = before != here
        between = changed & (here != after) & (np.minimum(before, after) < here) & (here < np.maximum(before, after))
        changes += int(changed.sum())
        mixed += int(between.sum())
    return mixed / changes if changes else 0.0
