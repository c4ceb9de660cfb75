"""The runs of each suite, and the tables that show them."""

import hashlib
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from goc.bench.config import OF_ROOMS, BenchConfig
from goc.errors import CaptureError

Views = Literal["full", "sparse"]
TRANSFORMS: dict[Views, str] = {"full": "transforms.json", "sparse": "transforms_sparse.json"}
Input = Literal["exact", "kinect", "affine", "monocular", "photographs", "masks"]
"""exact: depth and ids as rendered. kinect: noisy depth. affine: depth of unknown scale and offset, blurred and noisy.
monocular: as affine, with slow errors of 3 % as networks make them. photographs: no depth. masks: a tenth of each
view's masks is spoiled."""
Kind = Literal["geometry", "completion", "labels"]
Method = Literal["carve", "fuse", "fuse-hull", "fuse-lite"]
"""carve: `goc carve`. fuse: given depth and ids are fused and meshed without splats, as if rendering were perfect.
fuse-hull, fuse-lite: as fuse, then objects are closed by the evidence hull or by the network that goc ships."""

SIX_LOSSES = {"depth": 0.3, "depth_normal": 0.1, "photometric": 0.3, "geometric": 0.3}
"""The paper's weights (§4.4)."""
_OPEN = ("--complete.method", "none")
"""Words for tables that do not show completed meshes, to save the time of completion."""
MADE = "synth"
"""Prefix of the names of rooms that `goc synth` made."""
_TITLES = {"depth": "L_d", "depth_normal": "L_dn", "photometric": "L_pho", "geometric": "L_geo"}


@dataclass(frozen=True, kw_only=True)
class Run:
    """One run: a capture, its input and how it is carved."""

    room: str
    views: Views
    input: Input = "exact"
    method: Method = "carve"
    words: tuple[str, ...] = ()
    """Words of the command line after the folders."""

    @property
    def name(self) -> str:
        """Name of its folder: readable, and different for different settings."""
        parts = [self.room, self.views, self.input, self.method]
        if self.words:
            parts.append(hashlib.sha256("\0".join(self.words).encode()).hexdigest()[:8])
        return "-".join(parts)


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """A row of a table, which shows the mean over its runs."""

    label: str
    runs: tuple[Run, ...]
    completed: bool = False
    """Judge the completed meshes instead of the observed ones."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table whose rows are compared with each other and with the paper."""

    title: str
    note: str
    kind: Kind
    rows: tuple[TableRow, ...]
    paper: str | None = None
    """Key in `paper.TABLES`."""


def rooms_of(config: BenchConfig) -> dict[str, Path]:
    """Find the rooms of the data folder, by name; `inputs.make_rooms` adds synthetic ones.

    Raises:
        CaptureError: a room is missing, or its ground truth is.
    """
    if config.data is None:
        return {}
    names = config.rooms or tuple(sorted(path.parent.name for path in config.data.glob("*/transforms.json")))
    rooms = {name: config.data / name for name in names}
    lacking = [f"{room}/{file}" for room in rooms.values() for file in _NEEDED if not (room / file).is_file()]
    if lacking or not rooms:
        first = lacking[0] if lacking else f"{config.data}/*/transforms.json"
        raise CaptureError(
            f"{config.data}: {max(1, len(lacking))} files are missing (first: {first}). "
            "A room has transforms.json, transforms_sparse.json and gt/points.npz; `goc synth room` makes one."
        )
    return rooms


_NEEDED = (*TRANSFORMS.values(), "gt/points.npz")


def plan(config: BenchConfig, rooms: list[str]) -> list[Table]:
    """List all tables of the chosen suites, in the order of the document."""
    common = _common_words(config)
    tables: list[Table] = []
    for suite in OF_ROOMS:
        if suite in config.suites:
            tables += _SUITES[suite](config, rooms, common)
    return tables


def _common_words(config: BenchConfig) -> tuple[str, ...]:
    words: list[str] = []
    if config.iterations is not None:
        words += ["--iterations", str(config.iterations)]
    if config.max_side_px is not None:
        words += ["--capture.max-side-px", str(config.max_side_px)]
    return tuple(words)


def _row(label: str, rooms: list[str], views: Views, words: tuple[str, ...] = (), **given: str) -> TableRow:
    return TableRow(label=label, runs=tuple(Run(room=room, views=views, words=words, **given) for room in rooms))  # type: ignore[arg-type]


def _rooms(config: BenchConfig, rooms: list[str], common: tuple[str, ...]) -> list[Table]:
    given, tables = _given(rooms), []
    for number, views in enumerate(TRANSFORMS, 1):
        rows = [
            _row("exact depth, fused (no splats)", given, views, method="fuse"),
            *(_row(f"· {room}, fused", [room], views, method="fuse") for room in rooms),
            _row("goc without completion", given, views, common),
            *(_row(f"· {room}", [room], views, common) for room in rooms),
            replace(_row("goc", given, views, common), completed=True),
            *(replace(_row(f"· {room}, completed", [room], views, common), completed=True) for room in rooms),
        ]
        tables.append(
            Table(
                title=f"Table {number}: {views} observation",
                note=f"Exact depth and given ids, preset fast. Means over {', '.join(given)}; then each room.",
                kind="geometry",
                rows=tuple(rows),
                paper=f"table{number}",
            )
        )
    return tables


def _completion(config: BenchConfig, rooms: list[str], common: tuple[str, ...]) -> list[Table]:
    given, tables = _given(rooms), []
    for views in TRANSFORMS:
        rows: list[TableRow] = []
        by_room = {f"· {room}, ": [room] for room in given} if len(given) > 1 else {}
        for label, some in ({"": given} | by_room).items():
            rows += [
                _row(f"{label}open", some, views, method="fuse"),
                replace(_row(f"{label}hull", some, views, method="fuse-hull"), completed=True),
                replace(_row(f"{label}lite", some, views, method="fuse-lite"), completed=True),
            ]
        note = f"Exact depth and given ids, fused, then closed. Means over {', '.join(given)}; then each room."
        tables.append(Table(title=f"Completion, {views} observation", note=note, kind="completion", rows=tuple(rows)))
    return tables


def _given(rooms: list[str]) -> list[str]:
    """Rooms that were not made by `goc synth`; all rooms if there are no others."""
    return [room for room in rooms if not room.startswith(MADE)] or rooms


def _sensors(config: BenchConfig, rooms: list[str], common: tuple[str, ...]) -> list[Table]:
    rooms = _given(rooms)
    rows = [
        _row("exact depth", rooms, "full", common),
        _row("depth of a structured-light sensor", rooms, "full", (*common, *_OPEN), input="kinect"),
        _row("affine depth: no scale, no offset, blur, noise", rooms, "full", (*common, *_OPEN), input="affine"),
        _row("affine depth with slow errors of 3 %", rooms, "full", (*common, *_OPEN), input="monocular"),
        _row("photographs only", rooms, "full", (*common, *_OPEN, "--capture.no-use-depth"), input="photographs"),
    ]
    note = "Full observation, given ids, preset fast; what kind of depth there is, differs."
    return [Table(title="Other sensors", note=note, kind="geometry", rows=tuple(rows))]


def _labels(config: BenchConfig, rooms: list[str], common: tuple[str, ...]) -> list[Table]:
    learned = (*common, *_OPEN, "--reconstruct.labels", "learned")
    rooms = _given(rooms)
    some = _ablated(config, rooms)
    rows = [
        _row("voted, clean masks", rooms, "full", common),
        _row("voted, 10 % of the masks spoiled", rooms, "full", (*common, *_OPEN), input="masks"),
        _row(f"voted, clean masks ({', '.join(some)})", some, config.ablation_views, common),
        _row(f"learned, clean masks ({', '.join(some)})", some, config.ablation_views, learned),
        _row(f"voted, 10 % spoiled ({', '.join(some)})", some, config.ablation_views, (*common, *_OPEN), input="masks"),
        _row(f"learned, 10 % spoiled ({', '.join(some)})", some, config.ablation_views, learned, input="masks"),
    ]
    note = "Share of an object's surface with the right id, and share of its true surface found under that id."
    return [Table(title="Labels", note=note, kind="labels", rows=tuple(rows))]


def _ablations(config: BenchConfig, rooms: list[str], common: tuple[str, ...]) -> list[Table]:
    some, views = _ablated(config, rooms), config.ablation_views
    tables = []
    for input in ("exact", "monocular"):
        rows = [_row("all six losses", some, views, (*common, *_OPEN, *_losses(SIX_LOSSES)), input=input)]
        for name in ("depth_normal", "depth", "photometric", "geometric"):
            words = (*common, *_OPEN, *_losses(SIX_LOSSES | {name: 0.0}))
            rows.append(_row(f"without {_TITLES[name]}", some, views, words, input=input))
        fast = common if input == "exact" else (*common, *_OPEN)
        rows.append(_row("preset fast", some, views, fast, input=input))
        if input == "monocular":
            rendered = ("--reconstruct.losses.multiview.neighbour-depth", "rendered")
            second = (*common, *_OPEN, *_losses(SIX_LOSSES), *rendered)
            rows.append(_row("all six, neighbours rendered, not cached", some, views, second, input=input))
        tables.append(
            Table(
                title=f"Table 4: a loss at a time, {input} depth",
                note=f"{', '.join(some)}, {views} observation, the paper's weights, as many steps as preset fast.",
                kind="geometry",
                rows=tuple(rows),
                paper="table4",
            )
        )
    return tables


def _paper(config: BenchConfig, rooms: list[str], common: tuple[str, ...]) -> list[Table]:
    some, views = _ablated(config, rooms), config.ablation_views
    sizes = _common_words(BenchConfig(max_side_px=config.max_side_px))
    rows = [
        _row("preset fast", some, views, common),
        _row("preset paper", some, views, ("--preset", "paper", *sizes)),
    ]
    note = f"{', '.join(some)}, {views} observation: 30,000 steps, all six losses, learned labels, against the default."
    return [Table(title="Paper against fast", note=note, kind="geometry", rows=tuple(rows), paper=None)]


def _ablated(config: BenchConfig, rooms: list[str]) -> list[str]:
    unknown = [room for room in config.ablation_rooms if room not in rooms]
    if unknown:
        raise CaptureError(f"--ablation-rooms: no room {unknown[0]!r}. There are: {', '.join(rooms)}.")
    return list(config.ablation_rooms) or rooms[:1]


def _losses(weights: dict[str, float]) -> tuple[str, ...]:
    words: list[str] = []
    for name, weight in weights.items():
        words += [f"--reconstruct.losses.{re.sub('_', '-', name)}", f"{weight:g}"]
    return tuple(words)


_SUITES = {
    "rooms": _rooms,
    "completion": _completion,
    "sensors": _sensors,
    "labels": _labels,
    "ablations": _ablations,
    "paper": _paper,
}
