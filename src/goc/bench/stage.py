"""The whole benchmark: rooms, inputs, runs, document."""

from pathlib import Path

from goc.bench.config import OF_ROOMS, BenchConfig
from goc.bench.document import document
from goc.bench.inputs import make_input, make_rooms
from goc.bench.osc import osc_document, osc_results
from goc.bench.plan import Run, Table, plan, rooms_of
from goc.bench.result import Result
from goc.bench.run import kept_result, measure
from goc.errors import BenchError
from goc.events import Listener, Progress, Warned, ignore
from goc.files import write_bytes
from goc.runs.machine import this_machine

_STAGE = "bench"


def bench(config: BenchConfig, out: Path, docs: Path, command: str, notify: Listener = ignore) -> dict[str, Result]:
    """Carry out every run that has no result yet, and write the document after each.

    Args:
        config: what is measured on what.
        out: folder of inputs, runs and results; what is there is not measured again, unless `config.fresh`.
        docs: file to write.
        command: what a user types to get this document; printed in it.
        notify: hears a Progress a run, and Warned of a run that failed.

    Returns:
        Results by the run's name.

    Raises:
        BenchError: a run failed; the others were still done, and the document written.
    """
    is_of_rooms = bool(set(config.suites) & set(OF_ROOMS))
    rooms = rooms_of(config) | make_rooms(config, out / "rooms", notify) if is_of_rooms else {}
    tables = plan(config, list(rooms))
    runs = _once(tables)
    results: dict[str, Result] = {}
    failures: list[str] = []
    for done, run in enumerate(runs):
        notify(Progress(stage=_STAGE, done=done, total=len(runs)))
        result = None if config.fresh else kept_result(out / "runs", run)
        if result is None:
            try:
                capture = make_input(rooms[run.room], run, out / "inputs", notify)
                result = measure(run, capture, rooms[run.room], out / "runs")
            except BenchError as error:
                failures.append(str(error))
                notify(Warned(stage=_STAGE, message=str(error)))
                continue
        results[run.name] = result
        write_bytes(docs, document(tables, results, this_machine(), command).encode())
    notify(Progress(stage=_STAGE, done=len(runs), total=len(runs)))
    networks = osc_document(config, osc_results(config, out / "osc", notify))
    if networks:
        text = document(tables, results, this_machine(), command)
        write_bytes(docs, "\n".join([text.rstrip("\n"), "", *networks]).encode())
    if failures:
        raise BenchError(f"{len(failures)} of {len(runs)} runs failed (first: {failures[0]})")
    return results


def _once(tables: list[Table]) -> list[Run]:
    """Each run once, in the order of the tables."""
    return list(dict.fromkeys(run for table in tables for row in table.rows for run in row.runs))
