"""Writes eval.json and eval.html."""

from pathlib import Path

from goc.evaluation.error_maps import worst_error_maps
from goc.evaluation.html_page import page
from goc.evaluation.result import Evaluation
from goc.events import Listener, Progress, ignore
from goc.files import write_bytes, write_json

JSON, PAGE = "eval.json", "eval.html"


def write_evaluation(evaluation: Evaluation, out: Path, worst: int = 4, notify: Listener = ignore) -> None:
    """Write eval.json and eval.html, each atomically; the page pictures the `worst` objects.

    Raises:
        FileError: the disk refuses, or a mesh that was evaluated is no longer there.
    """
    write_json(out / JSON, evaluation)
    notify(Progress(stage="draw the page", done=0, total=1))
    shown = worst_error_maps(evaluation, Path(evaluation.run), Path(evaluation.truth), worst)
    write_bytes(out / PAGE, page(evaluation, Path(evaluation.run).resolve().name, shown).encode())
    notify(Progress(stage="draw the page", done=1, total=1))
