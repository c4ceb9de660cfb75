"""docs/benchmarks.md: every figure in it comes from a result on disk, or is the paper's."""

import math

from goc.bench.paper import TABLES, PaperRow
from goc.bench.plan import Kind, Table, TableRow
from goc.bench.result import Result
from goc.runs.machine import Machine

_COLUMNS: dict[Kind, tuple[tuple[str, str, int], ...]] = {
    "geometry": (
        ("accuracy", "Acc", 4),
        ("completion", "Comp", 4),
        ("chamfer", "CD", 4),
        ("f_score_0.05", "F@5cm", 3),
        ("f_score_0.01", "F@1cm", 3),
        ("normal_consistency", "NC", 3),
        ("completion_seen", "Comp seen", 4),
        ("completion_unseen", "Comp unseen", 4),
        ("scene.chamfer", "scene CD", 4),
        ("scene.f_score_0.05", "scene F@5cm", 3),
        ("scene.normal_consistency", "scene NC", 3),
        ("label_accuracy", "right id", 3),
        ("watertight", "closed", 2),
        ("psnr_db", "PSNR dB", 1),
    ),
    "completion": (
        ("accuracy", "Acc", 4),
        ("completion", "Comp", 4),
        ("chamfer", "CD", 4),
        ("f_score_0.05", "F@5cm", 3),
        ("f_score_0.01", "F@1cm", 3),
        ("normal_consistency", "NC", 3),
        ("completion_seen", "Comp seen", 4),
        ("completion_unseen", "Comp unseen", 4),
        ("accuracy_seen", "Acc seen", 4),
        ("iou", "IoU", 3),
        ("watertight", "closed", 2),
    ),
    "labels": (
        ("label_accuracy", "right id", 4),
        ("label_recall", "found", 4),
        ("accuracy", "Acc", 4),
        ("f_score_0.05", "F@5cm", 3),
        ("psnr_db", "PSNR dB", 1),
    ),
}
_INTRODUCTION = """\
# Benchmarks

Written by `goc bench`; every figure was measured by it, except the rows marked *paper*, which quote the paper's tables
(other rooms, other hardware: compare the shape, not the level). Lengths in metres. Object columns are means over all
objects of all rooms in a row, scene columns means over rooms; protocol `goc` of `goc eval`
(docs/guide/eval.md). *objects* counts those found; a missing one scores F = 0. PSNR on views held out.
*right id*: share of the objects' surface that carries its id; *closed*: share of the objects that are watertight.
Times are wall clock, one run at a time, with whatever else the machine did meanwhile.
A dash is a run without a result yet.
"""


def document(tables: list[Table], results: dict[str, Result], machine: Machine, command: str) -> str:
    """The whole file as Markdown; a run without a result shows as a dash."""
    commits = sorted({result.commit for result in results.values() if result.commit})
    lines = [
        _INTRODUCTION,
        f"`{command}`\n",
        f"{machine.cpu}, {machine.cores} cores ({machine.simd}), {machine.memory_gb:g} GB, no GPU used; "
        f"{machine.system}, Python {machine.python}, PyTorch {machine.torch}; "
        f"at {', '.join(commits) or 'no commit'}.\n",
    ]
    for table in tables:
        lines += [_table(table, results), ""]
    return "\n".join([*lines, *_stages(results)])


def _stages(results: dict[str, Result]) -> list[str]:
    """Seconds a stage of every run that told them."""
    timed = [result for result in results.values() if result.stages]
    names = list(dict.fromkeys(name for result in timed for name in result.stages))
    if not timed:
        return []
    lines = [
        "## Seconds by stage\n",
        "A run a line: room, views, input, method, and a mark for its settings.\n",
        "| run | " + " | ".join(names) + " | together |",
        "|" + "---|" * (len(names) + 2),
    ]
    for result in timed:
        cells = [_shown(result.stages.get(name), 1) for name in names]
        lines.append("| " + " | ".join([result.run, *cells, _shown(sum(result.stages.values()), 1)]) + " |")
    return [*lines, ""]


def _table(table: Table, results: dict[str, Result]) -> str:
    columns = _COLUMNS[table.kind]
    head = ["", *(title for _, title, _ in columns), "objects", "min", "GB"]
    lines = [
        f"## {table.title}\n",
        f"{table.note}\n",
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
    ]
    lines += [_ours(row, results, columns) for row in table.rows]
    lines += [_theirs(quoted, columns) for quoted in TABLES.get(table.paper or "", ())]
    return "\n".join(lines)


def _ours(row: TableRow, results: dict[str, Result], columns: tuple[tuple[str, str, int], ...]) -> str:
    found = [results[run.name] for run in row.runs if run.name in results]
    if len(found) < len(row.runs):
        return "| " + " | ".join([row.label, *("–" for _ in columns), "–", "–", "–"]) + " |"
    values = [result.completed if row.completed else result.values for result in found]
    cells = [_shown(_mean([of_run.get(key) for of_run in values]), digits) for key, _, digits in columns]
    objects = f"{sum(result.found for result in found)} of {sum(result.objects for result in found)}"
    minutes = _shown(_mean([_minutes(result.seconds) for result in found]), 1)
    gigabytes = _shown(_mean([_gigabytes(result.peak_memory_mb) for result in found]), 2)
    return "| " + " | ".join([row.label, *cells, objects, minutes, gigabytes]) + " |"


def _theirs(quoted: PaperRow, columns: tuple[tuple[str, str, int], ...]) -> str:
    cells = [_shown(quoted.values.get(key), 4) for key, _, _ in columns]
    return "| " + " | ".join([f"*paper:* {quoted.label}", *cells, "", quoted.time, ""]) + " |"


def _minutes(seconds: float | None) -> float | None:
    return None if seconds is None else seconds / 60


def _gigabytes(megabytes: float | None) -> float | None:
    return None if megabytes is None else megabytes / 1000


def _mean(values: list[float | None]) -> float | None:
    """Of the values there are; None where one is missing: a mean over fewer rooms would not compare."""
    known = [value for value in values if value is not None and math.isfinite(value)]
    return sum(known) / len(known) if known and len(known) == len(values) else None


def _shown(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
