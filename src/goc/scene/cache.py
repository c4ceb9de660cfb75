"""What was computed of views, as much as fits into a budget: the one cache of all frame sources."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from threading import Lock
from typing import Any, Generic, TypeVar

from torch import Tensor

_FRESH = 2
"""Views that stay although the budget is spent: a step asks for its view and a neighbour several times."""
T = TypeVar("T")


class ViewCache(Generic[T]):
    """Keeps what was computed of the views that came first, and of the two that came last.

    Stages go through all views in turn, in order or shuffled anew each time. Keeping the views used last would then
    drop each one shortly before it is asked for again: of a budget that holds a fifth of the views, one call in fifty
    would find its view (a pass in order: none); with those that came first it is one in five.

    It may be called from several threads. Two that ask for the same view at once may both compute it, which costs time
    and nothing else. A cache that is sent to another process arrives empty, with the same budget.
    """

    def __init__(self, compute: Callable[[int], T], budget: int) -> None:
        """Wrap `compute`, a function of the view's index whose values are tensors or frozen dataclasses of them.

        Args:
            compute: must be picklable where the cache is to be sent to another process.
            budget: bytes of tensors that are kept for good.
        """
        self._compute = compute
        self._budget = budget
        self._kept: dict[int, T] = {}
        self._fresh: OrderedDict[int, T] = OrderedDict()
        self._held = 0
        self._lock = Lock()

    def __call__(self, index: int) -> T:
        """Return what is known of a view, computed now or earlier. Callers share it, and must not write into it."""
        with self._lock:
            for found in (self._kept, self._fresh):
                if index in found:
                    return found[index]
        value = self._compute(index)
        size = bytes_of(value)
        with self._lock:
            if index not in self._kept and self._held + size <= self._budget:
                self._kept[index] = value
                self._held += size
            elif index not in self._kept:
                self._fresh[index] = value
                while len(self._fresh) > _FRESH:
                    self._fresh.popitem(last=False)
        return value

    def __reduce__(self) -> tuple[Any, ...]:
        """What a pickle of the cache holds: how to compute and the budget, not the contents."""
        return type(self), (self._compute, self._budget)

    @property
    def held(self) -> int:
        """Bytes kept for good; the views that came last, beyond the budget, are not counted."""
        return self._held


def bytes_of(value: object) -> int:
    """Memory of a tensor, or of the tensors that are fields of a dataclass (a Frame's images, not its camera)."""
    if isinstance(value, Tensor):
        return value.nbytes
    if is_dataclass(value):
        parts = [getattr(value, item.name) for item in fields(value)]
        return sum(part.nbytes for part in parts if isinstance(part, Tensor))
    return 0
