"""Decoded views, as many as fit into a budget."""

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock

from goc.scene import Frame


class FrameCache:
    """Keeps the views used last; safe to call from several threads.

    Two threads that ask for the same view at once may both decode it, which costs time and nothing else.
    """

    def __init__(self, decode: Callable[[int], Frame], count: int, budget: int) -> None:
        """Wrap `decode`, a function of the view's index, with a budget in bytes."""
        self._decode = decode
        self._indices = range(count)
        self._budget = budget
        self._kept: OrderedDict[int, Frame] = OrderedDict()
        self._held = 0
        self._lock = Lock()

    def __call__(self, index: int) -> Frame:
        """Return a view, decoded now or earlier; negative indices count from the end."""
        index = self._indices[index]
        with self._lock:
            if index in self._kept:
                self._kept.move_to_end(index)
                return self._kept[index]
        frame = self._decode(index)
        with self._lock:
            if index not in self._kept:
                self._kept[index] = frame
                self._held += bytes_of(frame)
            while self._held > self._budget and self._kept:
                _, oldest = self._kept.popitem(last=False)
                self._held -= bytes_of(oldest)
        return frame

    @property
    def held(self) -> int:
        """Bytes of decoded views kept now."""
        return self._held


def bytes_of(frame: Frame) -> int:
    """Memory of a view's images."""
    images = (frame.image, frame.depth, frame.normals, frame.ids)
    return sum(image.nbytes for image in images if image is not None)
