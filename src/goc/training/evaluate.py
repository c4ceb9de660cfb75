"""`goc osc eval`: completions of held-out meshes, by number of views, beside what needs no training."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from goc.complete import Network
from goc.events import Listener, Progress, ignore
from goc.training.held_out import (
    Case,
    Field,
    Score,
    case_of,
    guess_convex,
    guess_hull,
    guess_network,
    guess_nothing,
    score,
)
from goc.training.library import open_library
from goc.training.masking import MaskConfig, mask
from goc.training.solids import Solid

GROUPS = {"1-3 views": (1, 3), "4-6 views": (4, 6), "room": (7, 99)}


@dataclass(frozen=True, kw_only=True)
class EvalConfig:
    """How completions are scored."""

    masks: int = 3
    """Masks of each shape: one of 1-3 views, one of 4-6, one as in a scanned room; more in rounds."""
    shapes: int | None = None
    """Only so many shapes, evenly chosen; all by default."""
    cells: int = 96
    """Lattice that fields are composed and meshed on."""
    threshold: float = 0.5
    """Occupancy at the surface. The paper's T_b = 0.3 inflates it (docs/decisions)."""
    noise: float = 1.0
    """Strength of depth noise, as in training."""
    seed: int = 0
    """Of the masks."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """Mean scores of one method on one group of masks."""

    group: str
    method: str
    count: int
    scores: dict[str, float]


def evaluate(data: Path, network: Network | None, config: EvalConfig, notify: Listener = ignore) -> tuple[Row, ...]:
    """Score the shapes of split val in a prepared folder.

    Args:
        data: what `goc osc prepare` wrote.
        network: None scores what needs no training alone.
        config: masks and lattice.
        notify: hears progress.

    Raises:
        TrainError: no shapes of split val.
    """
    library = open_library(data, "val")
    count = min(config.shapes or len(library), len(library))
    chosen = np.linspace(0, len(library) - 1, count).round().astype(int)
    found: list[tuple[str, str, Score]] = []
    for done, index in enumerate(chosen):
        for case, group in _cases(library[int(index)], config, int(index)):
            for method, field in _fields(case, network, config):
                found.append((group, method, score(case, field)))
        notify(Progress(stage="evaluate", done=done + 1, total=count))
    return _means(found)


def _cases(solid: Solid, config: EvalConfig, index: int) -> Iterable[tuple[Case, str]]:
    for number in range(config.masks):
        group = list(GROUPS)[number % len(GROUPS)]
        random = np.random.default_rng([config.seed, 7, index, number])
        for _ in range(8):
            masked = mask(solid, _masking(group, config), random)
            if masked is not None and GROUPS[group][0] <= masked.views <= GROUPS[group][1]:
                yield case_of(masked, config.cells), group
                break


def _masking(group: str, config: EvalConfig) -> MaskConfig:
    in_room = group == "room"
    return MaskConfig(
        arc=0.0 if in_room else 1.0,
        room=1.0 if in_room else 0.0,
        noise=config.noise,
        without_space=0.0,
        jitter=0.0,
    )


def _fields(case: Case, network: Network | None, config: EvalConfig) -> Iterable[tuple[str, Field]]:
    yield "nothing", case.composed(guess_nothing(case))
    yield "evidence hull", case.composed(guess_hull(case))
    yield "convex hull", case.composed(guess_convex(case))
    if network is not None:
        guess = guess_network(case, network, config.threshold)
        yield "network alone", guess
        yield "network", case.composed(guess)


def _means(found: list[tuple[str, str, Score]]) -> tuple[Row, ...]:
    rows = []
    for group in (*GROUPS, "all"):
        for method in dict.fromkeys(method for _, method, _ in found):
            own = [asdict(s) for g, m, s in found if m == method and group in (g, "all")]
            if own:
                means = {name: float(np.mean([s[name] for s in own if np.isfinite(s[name])])) for name in own[0]}
                rows.append(Row(group=group, method=method, count=len(own), scores=means))
    return tuple(rows)


def table(rows: Iterable[Row]) -> str:
    """The rows as a Markdown table."""
    head = "| group | method | n | IoU | CD mean | CD sum | F@2% | NC | undecided right |\n" + "|---" * 9 + "|"
    lines = [head]
    for row in rows:
        figures = " | ".join(f"{value:.4f}" for value in row.scores.values())
        lines.append(f"| {row.group} | {row.method} | {row.count} | {figures} |")
    return "\n".join(lines) + "\n"
