"""Which instances of a labelled data set are the room, and what the others are called."""

from collections.abc import Iterable, Sequence

import numpy as np

from goc.capture.pixels import Pixels, codes_in
from goc.scene import ROOM, UNLABELLED

_SAMPLES = 60
_ROOM_WORDS = {
    "wall", "floor", "ceiling", "door", "doorframe", "door frame", "window", "windowsill", "window frame", "curtain",
    "curtains", "blinds", "mirror", "beam", "column", "pillar", "room", "background",
}  # fmt: skip


def is_room(name: str) -> bool:
    """Whether a class of such a name belongs to the room: what bounds it, and what is flat upon that."""
    words = name.strip().lower().replace("_", " ").replace("-", " ")
    return words in _ROOM_WORDS or words.removesuffix("s") in _ROOM_WORDS


def table_of(rooms: Iterable[int], absent: int | None, most: int = 255) -> tuple[tuple[int, int], ...]:
    """Ids of instance images whose values 0 to `most` are ids, but for some; 255 is one too.

    Args:
        rooms: values that are a part of the room, and become 0.
        absent: value of no instance at all, which becomes unlabelled.
        most: the largest value.
    """
    flat = set(rooms)
    return tuple(
        (value, UNLABELLED if value == absent else ROOM if value in flat else value) for value in range(most + 1)
    )


def classes_of(pairs: Sequence[tuple[Pixels, Pixels]]) -> dict[int, int]:
    """Class of each instance, by the majority of its pixels in at most 60 views, spread evenly.

    Args:
        pairs: image of instances and image of classes of each view, of one raster.

    Raises:
        FileError: an image is damaged.
    """
    counts: dict[tuple[int, int], int] = {}
    step = max(1, -(-len(pairs) // _SAMPLES))
    for instances, classes in pairs[::step]:
        seen = np.stack([codes_in(instances).astype(np.int64), codes_in(classes)], -1).reshape(-1, 2)
        for pair, count in zip(*np.unique(seen, axis=0, return_counts=True), strict=True):
            key = (int(pair[0]), int(pair[1]))
            counts[key] = counts.get(key, 0) + int(count)
    best: dict[int, tuple[int, int]] = {}
    for (instance, kind), count in counts.items():
        best[instance] = max(best.get(instance, (0, 0)), (count, kind))
    return {instance: kind for instance, (_, kind) in sorted(best.items())}
