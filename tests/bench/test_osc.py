"""Tables 5 to 7: which networks are trained, what is kept, and what is said of those that are not run."""

import pytest

from goc.bench import BenchConfig, bench, osc
from goc.bench.config import OscBenchConfig
from goc.bench.osc import OscCell, cells_of, osc_document, osc_results
from goc.errors import BenchError, ConfigError
from goc.events import Warned, ignore
from goc.files import write_bytes

SUITES = ("osc-sizes", "masks", "shapes")
SCORES = (
    '{"iou": 0.9, "accuracy": 0.01, "completion": 0.02, "chamfer_mean": 0.015, "chamfer_sum": 0.03, '
    '"f_1": 0.8, "f_2": 0.95}'
)
REPORT = '{{"shapes": 3, "rows": [{}]}}'.format(
    ", ".join(
        f'{{"group": "{group}", "method": "{method}", "scores": {SCORES}}}'
        for group in ("complete", "1-3 views", "all partial")
        for method in ("network", "convex hull")
    )
)


@pytest.fixture
def told(monkeypatch):
    """The words of every command, none of which is run; one that trains by random masks fails."""
    words_told = []

    def goc(words, own):
        words_told.append(list(words))
        if "random" in words:
            raise BenchError("it failed")
        if words[0] == "eval":
            write_bytes(own / "scores.json", REPORT.encode())

    monkeypatch.setattr(osc, "_goc", goc)
    return words_told


def test_each_network_is_trained_once_for_all_tables():
    config = BenchConfig(suites=SUITES, osc=OscBenchConfig(steps=5, sizes=("S", "M")))
    names = [cell.name for cell in cells_of(config)]
    assert names == ["osc-S-visible-5", "osc-M-visible-5", "osc-S-none-5", "osc-S-random-5", "osc-lite-visible-0"]
    assert cells_of(BenchConfig(suites=("rooms",))) == []


def test_a_network_is_trained_scored_and_kept(told, tmp_path):
    config = BenchConfig(suites=("osc-sizes",), osc=OscBenchConfig(data=tmp_path, steps=5, sizes=("S",), shapes=2))
    found = osc_results(config, tmp_path / "osc", ignore)
    train, score = told
    assert train[:1] + train[2:] == ["train", "--size", "S", "--steps", "5", "--data", str(tmp_path)] + [
        *("--masking.strategy", "visible", "--optimiser.rate", "1e-4")
    ]
    assert score[:2] == ["eval", str(tmp_path)] and score[-2:] == ["--shapes", "2"]
    assert found[OscCell(size="S", steps=5)].scores["complete"]["iou"] == 0.9
    assert osc_results(config, tmp_path / "osc", ignore) == found and len(told) == 2


def test_the_document_has_the_paper_s_rows_and_says_what_was_not_run(told, tmp_path):
    heard = []
    config = BenchConfig(suites=SUITES, osc=OscBenchConfig(data=tmp_path, steps=5, sizes=("S",)))
    results = osc_results(config, tmp_path / "osc", heard.append)
    assert [event.message for event in heard if isinstance(event, Warned)] == ["it failed"]
    text = "\n".join(osc_document(config, results))
    assert "| OSC-S | 6 | 4 | 63 M | 0.900 | 0.060 | 0.800 | 0.900 | 0.060 | 0.800 |" in text
    assert "| OSC-L | 14 | 8 | 139 M | not run | not run | not run | not run | not run | not run |" in text
    assert "| OSC-S, Visible mask | 0.0100 | 0.0200 | 0.0150 | 0.9500 |" in text
    assert "| OSC-S, Random drop | not run |" in text
    assert "| *paper:* OSC | 0.975 | 0.018 | 0.987 |" in text


def test_without_shapes_nothing_runs_and_no_room_is_made(told, tmp_path):
    config = BenchConfig(suites=SUITES)
    assert bench(config, tmp_path / "out", tmp_path / "tables.md", "goc bench") == {}
    assert told == []
    text = (tmp_path / "tables.md").read_text()
    assert "## Table 6: strategies of masking" in text and "| OSC-lite, as shipped | not run |" in text
    assert not (tmp_path / "out" / "rooms").exists()
    with pytest.raises(ConfigError, match=r"sizes names none\. There are: S, M, L"):
        OscBenchConfig(sizes=())
