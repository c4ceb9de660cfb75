"""Shows events to the user: a bar for each stage on a terminal, otherwise a line every few seconds."""

import math
import sys
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TaskID, TextColumn
from rich.progress import Progress as Bars
from rich.table import Column
from rich.text import Text

from goc.events import Event, Listener, Progress, Snapshot, Warned

_WINDOW = 20.0
"""Seconds over which a rate is measured."""
_REDRAW, _SPEAK = 0.1, 5.0
"""Seconds between changes of a bar, and between lines of a log."""


class Pace:
    """Speed of a stage, and the time that it still takes."""

    def __init__(self, event: Progress, now: float) -> None:
        """Start at the first event of a stage; steps that are already done then do not count for the rate."""
        self.started = now
        self._marks: deque[tuple[float, int]] = deque([(now, event.done)])

    def mark(self, event: Progress, now: float) -> None:
        """Record how many steps are done at time `now`, seconds."""
        self._marks.append((now, event.done))
        while len(self._marks) > 2 and now - self._marks[1][0] > _WINDOW:
            self._marks.popleft()

    def is_new_round(self, event: Progress) -> bool:
        """Whether the stage has started again."""
        return event.done < self._marks[-1][1]

    @property
    def rate(self) -> float | None:
        """Steps a second; None while unknown."""
        (then, before), (now, done) = self._marks[0], self._marks[-1]
        return (done - before) / (now - then) if now > then and done > before else None

    def describe(self, event: Progress, now: float) -> str:
        """Progress in words, for example `300/3000  16.2 it/s  2 min 47 s left  PSNR 24.1 dB  60,000 splats`."""
        words = [f"{event.done}/{event.total}"]
        if event.done >= event.total:
            words.append(f"in {duration(now - self.started)}")
        elif self.rate is not None:
            words += [f"{self.rate:.1f} it/s", f"{duration((event.total - event.done) / self.rate)} left"]
        words += [figure(name, value) for name, value in event.figures.items() if math.isfinite(value)]
        return "  ".join(words)


def duration(seconds: float) -> str:
    """A duration in words, for example `7 s`, `2 min 05 s` or `1 h 20 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest:02} s"
    return f"{minutes // 60} h {minutes % 60:02} min"


def figure(name: str, value: float) -> str:
    """A figure in words: `PSNR 24.1 dB` for the name "PSNR dB", `60,000 splats` for "splats"."""
    quantity, _, unit = name.partition(" ")
    return f"{quantity} {value:.1f} {unit}" if unit else f"{value:,.0f} {name}"


@contextmanager
def shown_progress() -> Iterator[Listener]:
    """Yield a listener that shows events on stderr, as bars if that is a terminal, else as lines."""
    if sys.stderr.isatty():
        with _Terminal() as listener:
            yield listener
    else:
        yield _Log()


class _Log:
    """Writes lines: the first and the last event of a stage, some between them, and each warning once."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._paces: dict[str, Pace] = {}
        self._spoke = -math.inf
        self._warned: set[Warned] = set()

    def __call__(self, event: Event) -> None:
        now = time.monotonic()
        if isinstance(event, Warned):
            if event not in self._warned:
                self._warned.add(event)
                self._line(f"warning: {event.message}", event.stage, now)
            return
        if isinstance(event, Snapshot):
            return
        pace, is_new = _pace(self._paces, event, now)
        if is_new or event.done >= event.total or now - self._spoke >= _SPEAK:
            self._line(pace.describe(event, now), event.stage, now)

    def _line(self, words: str, stage: str, now: float) -> None:
        self._spoke = now
        sys.stderr.write(f"[{now - self._began:7.1f} s] {stage}: {words}\n")
        sys.stderr.flush()


class _Terminal:
    """Shows one line with a bar for each stage."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)
        one_line = Column(no_wrap=True, overflow="ellipsis")
        words = TextColumn("{task.fields[words]}", markup=False, table_column=one_line)
        columns = (TextColumn("{task.description:<13}"), BarColumn(12), words)
        self._bars = Bars(*columns, console=self._console, refresh_per_second=5)
        self._tasks: dict[str, TaskID] = {}
        self._paces: dict[str, Pace] = {}
        self._drawn = -math.inf
        self._warned: set[Warned] = set()

    def __enter__(self) -> Listener:
        self._bars.start()
        return self._hear

    def __exit__(self, *failure: object) -> None:
        self._bars.stop()

    def _hear(self, event: Event) -> None:
        if isinstance(event, Warned):
            if event not in self._warned:
                self._warned.add(event)
                self._console.print(Text(f"warning: {event.stage}: {event.message}", style="yellow"))
            return
        if isinstance(event, Snapshot):
            return
        now = time.monotonic()
        pace, is_new = _pace(self._paces, event, now)
        if not (is_new or event.done >= event.total or now - self._drawn >= _REDRAW):
            return
        self._drawn = now
        words = pace.describe(event, now)
        if event.stage not in self._tasks:
            self._tasks[event.stage] = self._bars.add_task(event.stage, total=event.total, words=words)
        task = self._tasks[event.stage]
        self._bars.update(task, completed=event.done, total=event.total, words=words)


def _pace(paces: dict[str, Pace], event: Progress, now: float) -> tuple[Pace, bool]:
    """Return the pace of the event's stage, and whether the stage has just started."""
    pace = paces.get(event.stage)
    if pace is None or pace.is_new_round(event):
        paces[event.stage] = Pace(event, now)
        return paces[event.stage], True
    pace.mark(event, now)
    return pace, False
