import io
import math
import sys

import pytest

from assets import box_scene
from goc.cli.progress import Pace, duration, figure, shown_progress
from goc.events import Progress, Snapshot, Warned


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.2, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 00 s"),
        (125.0, "2 min 05 s"),
        (3599.7, "1 h 00 min"),
        (4801.0, "1 h 20 min"),
    ],
)
def test_durations_are_spoken(seconds, words):
    assert duration(seconds) == words


def test_figures_carry_their_unit_or_count():
    assert figure("PSNR dB", 28.04) == "PSNR 28.0 dB"
    assert figure("splats", 60000.0) == "60,000 splats"


def at(done, total=100, **figures):
    return Progress(stage="reconstruct", done=done, total=total, figures=figures)


def test_pace_is_the_rate_of_the_last_seconds_and_what_is_left_at_it():
    pace = Pace(at(40), now=0.0)  # resumed at 40: those steps cost nothing
    pace.mark(at(50), now=1.0)
    assert pace.rate == pytest.approx(10.0)
    for second in range(2, 60):
        pace.mark(at(50 + (second - 1) // 2), now=float(second))
    assert pace.rate == pytest.approx(0.5, rel=0.1)
    words = pace.describe(at(79, splats=1234.0), now=60.0)
    assert words.startswith("79/100  0.5 it/s  40 s left")
    assert words.endswith("1,234 splats")


def test_a_finished_stage_tells_how_long_it_took_and_leaves_out_what_is_not_a_number():
    pace = Pace(at(1), now=10.0)
    done = Progress(stage="reconstruct", done=100, total=100, figures={"PSNR dB": math.nan})
    pace.mark(done, now=75.0)
    assert pace.describe(done, now=75.0) == "100/100  in 1 min 05 s"


def test_without_a_terminal_there_are_few_lines_and_each_warning_once(capsys):
    with shown_progress() as notify:
        for done in range(1, 101):
            notify(at(done))
        for _ in range(3):
            notify(Warned(stage="capture", message="no depth"))
        notify(at(1))  # another round
    lines = capsys.readouterr().err.splitlines()
    assert [line.split("] ")[1].split("  ")[0] for line in lines] == [
        "reconstruct: 1/100",
        "reconstruct: 100/100",
        "capture: warning: no depth",
        "reconstruct: 1/100",
    ]


def test_on_a_terminal_every_stage_is_one_line(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setenv("TERM", "xterm")
    with shown_progress() as notify:
        for done in range(1, 101):
            notify(at(done, splats=80000.0))
        for _ in range(2):
            notify(Warned(stage="capture", message="[red]no depth"))
        notify(Progress(stage="export", done=2, total=2))
    final = terminal.getvalue().split("\x1b[2K")[-1]
    assert terminal.getvalue().count("warning: capture: [red]no depth") == 1
    assert [line.split()[0] for line in final.splitlines() if line.strip().startswith(("recon", "export"))] == [
        "reconstruct",
        "export",
    ] or "export" in final


def test_a_log_says_nothing_of_snapshots(capsys):
    with shown_progress() as notify:
        notify(Snapshot(stage="reconstruct", step=50, splats=box_scene().splats))
    assert capsys.readouterr().err == ""
