"""Tables 5, 6 and 7 of the paper: sizes of the completion network, strategies of masking, complete input."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from goc.bench.config import BenchConfig
from goc.bench.run import source_commit
from goc.complete import SHIPPED, SIZES, build
from goc.errors import BenchError
from goc.events import Listener, Progress, Warned
from goc.files import is_file, read_json, write_json

OscSuite = Literal["osc-sizes", "masks", "shapes"]
Strategy = Literal["none", "random", "visible"]
_COMPLETE, _PARTIAL = "complete", "all partial"
_RESULT, _SCORES, _LOG = "result.json", "scores.json", "osc.log"
_FEW = "1-3 views"
_RATE = "1e-4"
"""The paper's learning rate, for its own sizes."""
_METHOD = "network"
_STRATEGIES: dict[Strategy, str] = {"none": "w/o mask", "random": "Random drop", "visible": "Visible mask"}
_PAPER_SIZES = {"S": "0.969 | 0.018 | 0.983", "M": "0.975 | 0.018 | 0.987", "L": "0.976 | 0.017 | 0.990"}
_PAPER_MASKS = {
    "none": "0.0115 | 0.0748 | 0.0432 | 0.8380",
    "random": "0.0152 | 0.0567 | 0.0360 | 0.8822",
    "visible": "0.0073 | 0.0575 | 0.0324 | 0.9033",
}
_PAPER_SHAPES = {
    "OccNet": "0.825 | 0.072 | 0.858",
    "ConvOccNet": "0.888 | 0.052 | 0.933",
    "IF-Net": "0.934 | 0.041 | 0.967",
    "3DILG": "0.953 | 0.040 | 0.970",
    "3D2VS": "0.965 | 0.038 | 0.967",
    "OSC": "0.975 | 0.018 | 0.987",
}


@dataclass(frozen=True, kw_only=True)
class OscCell:
    """One network that is trained and scored; lite is not trained, it comes with goc."""

    size: Literal["lite", "S", "M", "L"]
    strategy: Strategy = "visible"
    steps: int = 0

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"osc-{self.size}-{self.strategy}-{self.steps}"


class OscResult(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Scores of one network, stored as result.json in its folder."""

    cell: str
    commit: str
    shapes: int
    scores: dict[str, dict[str, float | None]]
    """Mean scores of the completed meshes by group of inputs."""


def cells_of(config: BenchConfig) -> list[OscCell]:
    """The networks that the chosen suites need, each once."""
    cells: list[OscCell] = []
    if "osc-sizes" in config.suites:
        cells += [OscCell(size=size, steps=config.osc.steps) for size in config.osc.sizes]
    if "masks" in config.suites:
        cells += [_masked(config, strategy) for strategy in _STRATEGIES]
    if "shapes" in config.suites:
        cells += [OscCell(size="lite"), OscCell(size=config.osc.sizes[-1], steps=config.osc.steps)]
    return list(dict.fromkeys(cells))


def _masked(config: BenchConfig, strategy: Strategy) -> OscCell:
    return OscCell(size=config.osc.sizes[0], strategy=strategy, steps=config.osc.steps)


def osc_results(config: BenchConfig, folder: Path, notify: Listener) -> dict[OscCell, OscResult]:
    """Train and score every network that has a budget and no result yet.

    Args:
        config: without `osc.data` nothing is scored, with `osc.steps` 0 nothing is trained.
        folder: of all networks; a stopped training in it goes on.
        notify: hears progress, and a warning for each that failed.

    Returns:
        Results of those that were run, now or before.
    """
    found: dict[OscCell, OscResult] = {}
    cells = cells_of(config)
    for done, cell in enumerate(cells):
        notify(Progress(stage="bench", done=done, total=len(cells)))
        kept = folder / cell.name / _RESULT
        if is_file(kept) and not config.fresh:
            found[cell] = read_json(kept, OscResult)
        elif config.osc.data is not None and (cell.steps or cell.size == "lite"):
            try:
                found[cell] = _measured(cell, config, config.osc.data, folder / cell.name)
            except BenchError as error:
                notify(Warned(stage="bench", message=str(error)))
    return found


def _measured(cell: OscCell, config: BenchConfig, data: Path, own: Path) -> OscResult:
    own.mkdir(parents=True, exist_ok=True)
    weights = SHIPPED
    if cell.size != "lite":
        words = ["train", str(own / "training"), "--size", cell.size, "--steps", str(cell.steps), "--data", str(data)]
        _goc([*words, "--masking.strategy", cell.strategy, "--optimiser.rate", _RATE], own)
        weights = own / "training" / "weights.safetensors"
    words = ["eval", str(data), "--weights", str(weights), "--json", str(own / _SCORES)]
    _goc([*words, *(() if config.osc.shapes is None else ("--shapes", str(config.osc.shapes)))], own)
    report = msgspec.json.decode((own / _SCORES).read_bytes())
    result = OscResult(
        cell=cell.name,
        commit=source_commit(),
        shapes=report["shapes"],
        scores={row["group"]: row["scores"] for row in report["rows"] if row["method"] == _METHOD},
    )
    write_json(own / _RESULT, result)
    return result


def _goc(words: Sequence[str], own: Path) -> None:
    """Run `goc osc` in a process of its own; what it says goes to a log."""
    with (own / _LOG).open("a", encoding="utf-8") as log:
        done = subprocess.run(
            [sys.executable, "-m", "goc.cli", "osc", *words], stdout=log, stderr=subprocess.STDOUT, check=False
        )
    if done.returncode:
        raise BenchError(f"{own.name}: goc osc {words[0]} ended with {done.returncode} (all of it: {own / _LOG})")


def osc_document(config: BenchConfig, results: dict[OscCell, OscResult]) -> list[str]:
    """Tables 5, 6 and 7 as lines of Markdown; what was not run says so."""
    shapes = max((result.shapes for result in results.values()), default=0)
    note = (
        f"{shapes or 'No'} shapes of split val ({config.osc.data or 'no --osc.data'}), {config.osc.steps} steps each. "
        "CD: Acc + Comp of shapes that fill [-1, 1], F at 0.02 of them, as in 3DShape2VecSet. The paper's are ShapeNet "
        "(Tables 5 and 7) and its own rooms (Table 6, metres): compare the shape, not the level.\n"
    )
    lines: list[str] = []
    if "osc-sizes" in config.suites:
        lines += ["## Table 5: sizes of the network, complete input\n", note, *_sizes(config, results), ""]
    if "masks" in config.suites:
        lines += ["## Table 6: strategies of masking, partial input\n", note, *_masks(config, results), ""]
    if "shapes" in config.suites:
        lines += ["## Table 7: complete input\n", note, *_shapes(config, results), ""]
    return lines


def _sizes(config: BenchConfig, results: dict[OscCell, OscResult]) -> list[str]:
    lines = ["| model | enc. | dec. | params | IoU | CD | F | 1-3 views: IoU | CD | F |", "|" + "---|" * 10]
    for size, paper in _PAPER_SIZES.items():
        sizes = SIZES[size]
        params = sum(value.numel() for value in build(sizes).parameters()) / 1e6
        head = f"OSC-{size} | {sizes.encoder} | {sizes.decoder}"
        cell = OscCell(size=size, steps=config.osc.steps)  # type: ignore[arg-type]
        few = _solid(results.get(cell), _FEW)
        lines.append(f"| {head} | {params:.0f} M | {_solid(results.get(cell), _COMPLETE)} | {few} |")
        lines.append(f"| *paper:* {head} |  | {paper} |  |  |  |")
    return lines


def _masks(config: BenchConfig, results: dict[OscCell, OscResult]) -> list[str]:
    lines = ["| trained with | Acc | Comp | CD | F@2% |", "|" + "---|" * 5]
    for strategy, label in _STRATEGIES.items():
        keys = (("accuracy", 4), ("completion", 4), ("chamfer_mean", 4), ("f_2", 4))
        result = results.get(_masked(config, strategy))
        lines.append(f"| OSC-{config.osc.sizes[0]}, {label} | {_figures(result, _PARTIAL, keys)} |")
        lines.append(f"| *paper:* {label} | {_PAPER_MASKS[strategy]} |")
    return lines


def _shapes(config: BenchConfig, results: dict[OscCell, OscResult]) -> list[str]:
    last = config.osc.sizes[-1]
    lines = ["| model | IoU | CD | F |", "|" + "---|" * 4]
    lines.append(f"| OSC-lite, as shipped | {_solid(results.get(OscCell(size='lite')), _COMPLETE)} |")
    trained = results.get(OscCell(size=last, steps=config.osc.steps))
    lines.append(f"| OSC-{last} | {_solid(trained, _COMPLETE)} |")
    return [*lines, *(f"| *paper:* {label} | {figures} |" for label, figures in _PAPER_SHAPES.items())]


def _solid(result: OscResult | None, group: str) -> str:
    return _figures(result, group, (("iou", 3), ("chamfer_sum", 3), ("f_1", 3)))


def _figures(result: OscResult | None, group: str, keys: Sequence[tuple[str, int]]) -> str:
    if result is None or group not in result.scores:
        return " | ".join(["not run"] * len(keys))
    scores = result.scores[group]
    doubled = {"chamfer_sum": 2.0}  # lengths in longest sides; shapes that fill [-1, 1] are 2 long
    found = [(scores[key], doubled.get(key, 1.0), digits) for key, digits in keys]
    return " | ".join("–" if value is None else f"{times * value:.{digits}f}" for value, times, digits in found)
