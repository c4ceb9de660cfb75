from dataclasses import replace

import pytest

from goc.bench import BenchConfig, bench, stage
from goc.bench.document import document
from goc.bench.paper import TABLES
from goc.bench.plan import Run, Table, TableRow, plan, rooms_of
from goc.bench.result import Result
from goc.bench.run import RESULT, kept_result, measure, source_commit
from goc.errors import BenchError, CaptureError, ConfigError, FileError
from goc.events import Warned
from goc.files import write_json
from goc.runs.machine import this_machine
from truths import write_truth

VALUES = {"accuracy": 0.005, "completion": 0.02, "chamfer": 0.0125, "f_score_0.05": 0.95, "scene.f_score_0.05": 0.98}


def result_of(run, **given):
    result = Result(
        run=run.name,
        command="goc carve",
        commit="abc1234",
        created="2026-01-01T00:00:00+00:00",
        seconds=90.0,
        peak_memory_mb=1500.0,
        objects=10,
        found=9,
        values=dict(VALUES),
        completed=VALUES | {"accuracy": 0.009},
    )
    return replace_struct(result, **given)


def replace_struct(struct, **given):
    return type(struct)(**{name: given.get(name, getattr(struct, name)) for name in struct.__struct_fields__})


def room(folder):
    (folder / "gt").mkdir(parents=True)
    for name in ("transforms.json", "transforms_sparse.json", "gt/points.npz"):
        (folder / name).write_text("x")


@pytest.fixture
def faked(monkeypatch, tmp_path):
    """A benchmark whose runs take no time; counts them, and fails those whose room is named in `broken`."""
    room(tmp_path / "data" / "den")
    done, broken = [], []

    def measure(run, capture, truth, folder):
        if run.input in broken:
            raise BenchError(f"{run.name}: goc carve ended with 5")
        done.append(run)
        result = result_of(run)
        write_json(folder / run.name / RESULT, result)
        return result

    monkeypatch.setattr(stage, "measure", measure)
    monkeypatch.setattr(stage, "make_rooms", lambda config, folder, notify: {})
    monkeypatch.setattr(stage, "make_input", lambda room, run, folder, notify: room)
    config = BenchConfig(data=tmp_path / "data", synth_rooms=0, suites=("rooms", "labels"))
    return config, done, broken, tmp_path


def test_every_suite_names_its_runs_apart():
    tables = plan(BenchConfig(), ["den", "hall"])
    runs = {run for table in tables for row in table.rows for run in row.runs}
    assert len({run.name for run in runs}) == len(runs)
    assert {run.input for run in runs} == {"exact", "kinect", "affine", "monocular", "photographs", "masks"}
    assert {table.paper for table in tables} >= {"table1", "table2", "table4"}


def test_an_ablation_leaves_out_one_loss():
    tables = plan(BenchConfig(suites=("ablations",)), ["den"])
    full, *without = [row.runs[0].words for row in tables[0].rows[:5]]
    assert "0" not in full
    for words in without:
        assert [a for a, b in zip(words, full, strict=True) if a != b] == ["0"]


def test_completion_closes_one_fusion_in_two_ways():
    tables = plan(BenchConfig(suites=("rooms", "completion")), ["den", "hall"])
    fused, completion = tables[0].rows[0], tables[2]
    assert [row.label for row in completion.rows[:3]] == ["open", "hull", "lite"]
    assert [row.completed for row in completion.rows[:3]] == [False, True, True]
    assert completion.rows[0].runs == fused.runs  # measured once for both suites
    assert [run.method for row in completion.rows[3:6] for run in row.runs] == ["fuse", "fuse-hull", "fuse-lite"]
    assert len(completion.rows) == 9


def test_a_fused_run_is_closed_judged_and_timed(tmp_path):
    truth = write_truth(tmp_path / "room")
    result = measure(Run(room="room", views="full", method="fuse-hull"), truth, truth, tmp_path / "runs")
    assert (result.objects, result.found, result.peak_memory_mb) == (2, 2, None)
    assert list(result.stages) == ["capture", "extract", "complete"]
    assert result.values["watertight"] == 0.0 and result.completed["watertight"] == 1.0
    again = measure(Run(room="room", views="full", method="fuse"), truth, truth, tmp_path / "runs")
    assert again.completed == {} and again.values == result.values


def test_settings_of_a_quick_look_reach_the_command_line():
    table = plan(BenchConfig(suites=("rooms",), iterations=50, max_side_px=128), ["den"])[0]
    assert table.rows[2].runs[0].words == ("--iterations", "50", "--capture.max-side-px", "128")


def test_what_is_measured_is_not_measured_again(faked):
    config, done, _, folder = faked
    first = bench(config, folder / "out", folder / "b.md", "goc bench")
    count = len(done)
    assert len(first) == count
    assert bench(config, folder / "out", folder / "b.md", "goc bench") == first
    assert len(done) == count
    bench(replace(config, fresh=True), folder / "out", folder / "b.md", "goc bench")
    assert len(done) == 2 * count


def test_a_run_that_fails_stops_no_other(faked):
    config, done, broken, folder = faked
    broken.append("masks")
    heard = []
    told = r"3 of 8 runs failed \(first: den-full-masks-carve-\w+: goc carve ended with 5\)"
    with pytest.raises(BenchError, match=told):
        bench(config, folder / "out", folder / "b.md", "goc bench", heard.append)
    assert sum(isinstance(event, Warned) for event in heard) == 3
    assert done and "| voted, 10 % of the masks spoiled | – |" in (folder / "b.md").read_text()
    broken.clear()
    bench(config, folder / "out", folder / "b.md", "goc bench")
    assert "–" not in (folder / "b.md").read_text()


def test_a_row_is_the_mean_of_its_runs():
    runs = (Run(room="a", views="full"), Run(room="b", views="full"))
    table = Table(title="T", note="N", kind="geometry", rows=(TableRow(label="both", runs=runs),), paper="table1")
    other = result_of(runs[1], values=VALUES | {"accuracy": 0.007, "chamfer": None}, seconds=30.0, found=10)
    text = document([table], {runs[0].name: result_of(runs[0]), runs[1].name: other}, this_machine(), "goc bench")
    line = next(line for line in text.splitlines() if line.startswith("| both"))
    cells = [cell.strip() for cell in line.split("|")]
    assert cells[2:6] == ["0.0060", "0.0200", "", "0.950"]  # no CD: one of the rooms has none
    assert cells[-4:-1] == ["19 of 20", "1.0", "1.50"]
    done = replace(table, rows=(TableRow(label="done", runs=runs, completed=True),))
    text_done = document([done], {run.name: result_of(run) for run in runs}, this_machine(), "goc bench")
    assert "| done | 0.0090 |" in text_done
    assert "*paper:* GOC without OSC | 0.0045 | 0.0543" in text
    assert "at abc1234" in text


def test_stages_of_timed_runs_are_a_table():
    runs = (Run(room="a", views="full"), Run(room="b", views="full", method="fuse"), Run(room="c", views="full"))
    table = Table(title="T", note="N", kind="completion", rows=(TableRow(label="all", runs=runs),))
    stages = ({"reconstruct": 50.0, "extract": 12.25}, {"extract": 9.0, "complete": 4.0}, {})
    results = {run.name: result_of(run, stages=of_run) for run, of_run in zip(runs, stages, strict=True)}
    text = document([table], results, this_machine(), "goc bench")
    lines = text[text.index("## Seconds by stage") :].splitlines()[4:]
    assert lines[0] == "| run | reconstruct | extract | complete | together |"
    assert lines[2:4] == [
        "| a-full-exact-carve | 50.0 | 12.2 |  | 62.2 |",
        "| b-full-exact-fuse |  | 9.0 | 4.0 | 13.0 |",
    ]
    assert len(lines) == 4  # the third run is of a time before stages were kept
    untimed = document([table], {runs[2].name: results[runs[2].name]}, this_machine(), "goc bench")
    assert "Seconds by stage" not in untimed


def test_the_papers_tables_agree_with_themselves():
    for quoted in (*TABLES["table1"], *TABLES["table2"]):
        halved = (quoted.values["accuracy"] + quoted.values["completion"]) / 2
        assert quoted.values["chamfer"] == pytest.approx(halved, abs=1e-4)


def test_rooms_are_found_or_refused(tmp_path):
    room(tmp_path / "den")
    assert list(rooms_of(BenchConfig(data=tmp_path))) == ["den"]
    (tmp_path / "den" / "gt" / "points.npz").unlink()
    with pytest.raises(CaptureError, match=r"1 files are missing \(first: .*den/gt/points.npz\)"):
        rooms_of(BenchConfig(data=tmp_path))
    with pytest.raises(CaptureError, match="hall/transforms.json"):
        rooms_of(BenchConfig(data=tmp_path, rooms=("hall",)))
    with pytest.raises(CaptureError, match="no room 'hall'. There are: den."):
        plan(BenchConfig(ablation_rooms=("hall",)), ["den"])


def test_refused_settings():
    with pytest.raises(ConfigError, match="BenchConfig.synth_rooms is 0, which leaves no rooms"):
        BenchConfig(synth_rooms=0)
    with pytest.raises(ConfigError, match="not given"):
        BenchConfig(rooms=("den",))
    with pytest.raises(ConfigError, match="synth_rooms is -1"):
        BenchConfig(synth_rooms=-1)
    with pytest.raises(ConfigError, match="There are: rooms, completion, sensors"):
        BenchConfig(suites=())


def test_a_damaged_result_is_named(tmp_path):
    run = Run(room="den", views="full")
    assert kept_result(tmp_path, run) is None
    (tmp_path / run.name).mkdir()
    (tmp_path / run.name / RESULT).write_text("{}")
    with pytest.raises(FileError, match="result.json"):
        kept_result(tmp_path, run)


def test_the_commit_is_one():
    assert source_commit().rstrip("+").isalnum() or source_commit() == ""
