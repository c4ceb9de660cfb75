"""What a run has to tell afterwards: seconds a stage, and warnings."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from goc.events import Event, Listener, Warned


@dataclass(eq=False)
class RunRecord:
    """A listener that passes every event on and remembers what the report needs. Mutable: one a run."""

    notify: Listener
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall-clock time of each finished stage, in the order in which they ended."""
    warnings: list[Warned] = field(default_factory=list)
    """Each once, in the order in which they came."""

    def __call__(self, event: Event) -> None:
        """Hear an event; a warning that was heard before goes no further."""
        if isinstance(event, Warned):
            if event in self.warnings:
                return
            self.warnings.append(event)
        self.notify(event)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time of a block for stage `name`; stages that come again add up."""
        started = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started
