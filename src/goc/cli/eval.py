"""`goc eval`: a run against complete ground truth."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from goc.cli.arguments import parse
from goc.cli.progress import shown_progress
from goc.evaluation import Evaluation, Matching, MeshChoice, Protocol, evaluate, write_evaluation
from goc.evaluation.metric_format import METRICS, summary_sentence, table_columns
from goc.settings import CountOrNone, Seed, Settings

_DESCRIPTION = """Compare what a run made with the complete truth of its capture.

RUN is the output folder of `goc carve`, or any folder of <id>.ply (and scene.ply). The truth is a capture with gt/, as
`goc synth` makes them. Writes eval.json and eval.html.

examples:
  goc eval kitchen --truth captures/kitchen
  goc eval kitchen --truth captures/kitchen --meshes observed --out scores
  goc eval meshes --truth captures/kitchen --match shape
  goc eval kitchen --truth captures/kitchen/transforms_sparse.json --protocol phyrecon-scannet"""


@dataclass(frozen=True, kw_only=True)
class Arguments(Settings):
    """The arguments of the command line."""

    run: Annotated[Path, tyro.conf.arg(metavar="RUN"), tyro.conf.Positional]
    """Folder of the run."""
    truth: Annotated[Path, tyro.conf.arg(metavar="CAPTURE")]
    """Capture with gt/, or a transforms file in it, whose views are the training poses of the published protocols."""
    protocol: Protocol = "goc"
    """goc: our own. The others follow published evaluations: docs/guide/eval.md."""
    match: Annotated[Matching | None, tyro.conf.arg(help_behavior_hint="")] = None
    """Match objects by id or by shape. Default: by shape where the run had no ids, else by id."""
    meshes: MeshChoice = "best"
    """observed: objects/<id>/observed.ply. completed: objects/<id>/mesh.ply. best: completed where there is one."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Folder for eval.json and eval.html. Default: RUN."""
    worst: CountOrNone = 4
    """Number of objects with pictures on the page, the worst first."""
    seed: Seed = 0
    """Random seed of all samples."""


def main(words: Sequence[str]) -> int:
    """Run `goc eval` with the words that follow it."""
    given = parse(Arguments, words, "goc eval", _DESCRIPTION)
    out = given.out or given.run
    with shown_progress() as notify:
        found = evaluate(given.run, given.truth, given.protocol, given.match, given.meshes, given.seed, notify)
        write_evaluation(found, out, given.worst, notify)
    console = Console(file=sys.stdout)
    console.print(_table(found))
    sys.stdout.write(f"{summary_sentence(found)}\n  figures  {out / 'eval.json'}\n  page     {out / 'eval.html'}\n")
    return 0


def _table(found: Evaluation) -> Table:
    """Table with one figure a row: its mean, its worst object and its value for the scene."""
    table = Table(title=f"{found.run} by {found.protocol}", title_justify="left", header_style="bold")
    table.add_column("")
    table.add_column("mean", justify="right", style="bold")
    table.add_column("over", justify="right", style="dim")
    table.add_column("worst", justify="right")
    table.add_column("object")
    table.add_column("scene", justify="right")
    for name in table_columns(found):
        word = METRICS[name]
        worst, whose = _worst(found, name)
        table.add_row(
            f"{word.title} {word.unit}".strip(),
            word.shown(found.mean.get(name)),
            str(found.mean_over.get(name, 0)),
            word.shown(worst),
            whose,
            word.shown((found.scene or {}).get(name)),
        )
    return table


def _worst(found: Evaluation, name: str) -> tuple[float | None, str]:
    """Worst value of a figure, with id and label of its object."""
    values = {id: item.figures[name] for id, item in found.objects.items() if item.figures.get(name) is not None}
    if not values:
        return None, ""
    pick = max if METRICS[name].less_is_better else min
    id = pick(values, key=lambda key: values[key] or 0.0)
    return values[id], f"{id} {found.objects[id].label}"
