"""Decoded views, as many as fit into a budget."""

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock

from goc.scene import Frame

_FRESH = 2
"""Views that stay although the budget is spent: a step asks for its view and a neighbour several times."""


class FrameCache:
    """Keeps the views that came first, and the two that came last; safe to call from several threads.

    Stages go through all views in turn, in order or shuffled anew each time. Keeping the views used last would then
    drop each one shortly before it is asked for again: of a budget that holds a fifth of the views, one call in fifty
    would find its view (a pass in order: none); with those that came first it is one in five.

    Two threads that ask for the same view at once may both decode it, which costs time and nothing else.
    """

    def __init__(self, decode: Callable[[int], Frame], count: int, budget: int) -> None:
        """Wrap `decode`, a function of the view's index, with a budget in bytes."""
        self._decode = decode
        self._indices = range(count)
        self._budget = budget
        self._kept: dict[int, Frame] = {}
        self._fresh: OrderedDict[int, Frame] = OrderedDict()
        self._held = 0
        self._lock = Lock()

    def __call__(self, index: int) -> Frame:
        """Return a view, decoded now or earlier; negative indices count from the end."""
        index = self._indices[index]
        with self._lock:
            found = self._kept.get(index) or self._fresh.get(index)
        if found is not None:
            return found
        frame = self._decode(index)
        with self._lock:
            if index not in self._kept and self._held + bytes_of(frame) <= self._budget:
                self._kept[index] = frame
                self._held += bytes_of(frame)
            elif index not in self._kept:
                self._fresh[index] = frame
                while len(self._fresh) > _FRESH:
                    self._fresh.popitem(last=False)
        return frame

    @property
    def held(self) -> int:
        """Bytes of decoded views kept for good; those that came last, beyond the budget, are not counted."""
        return self._held


def bytes_of(frame: Frame) -> int:
    """Memory of a view's images."""
    images = (frame.image, frame.depth, frame.normals, frame.ids)
    return sum(image.nbytes for image in images if image is not None)
