"""`goc bench`: the paper's tables, measured again on this machine."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from goc.bench import BenchConfig, bench
from goc.cli.arguments import parse
from goc.cli.failures import STOPPED, say
from goc.cli.progress import shown_progress

_DESCRIPTION = """Carve rooms with known geometry, judge what comes out, and write the tables as Markdown.

Every run is kept in --out and not repeated: after a stop, the same command continues. Runs that another version of goc
carved are kept too (result.json has their commit); --fresh measures all again.

examples:
  goc bench --suites rooms                                 a room made on the spot: needs no data
  goc bench --data captures --synth-rooms 0                all suites; hours on two cores
  goc bench --data captures --suites rooms ablations --iterations 500 --max-side-px 256
                                                           a quick look
  goc bench --suites osc-sizes masks shapes --osc.data prepared --osc.steps 20000 --docs tables.md
                                                           the paper's networks, trained and scored"""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments of the command line."""

    config: Annotated[BenchConfig, tyro.conf.arg(name="")] = field(default_factory=BenchConfig)
    out: Path = Path("out/bench")
    """Folder for inputs, runs and results."""
    docs: Path = Path("docs/benchmarks.md")
    """File to write."""


def main(words: Sequence[str]) -> int:
    """Run `goc bench` with the words that follow it."""
    arguments = parse(Arguments, words, "goc bench", _DESCRIPTION)
    command = shlex.join(["goc", "bench", *words])
    try:
        with shown_progress() as notify:
            results = bench(arguments.config, arguments.out, arguments.docs, command, notify)
    except KeyboardInterrupt:
        say(f"stopped; finished runs are kept. Continue with: {command}")
        return STOPPED
    sys.stdout.write(f"{len(results)} runs; the tables are in {arguments.docs}\n")
    return 0
